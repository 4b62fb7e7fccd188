// The keyboard as a stick: a key that is held is a dead-man button.

const WAYS = {
  KeyW: [1, 0, 0], ArrowUp: [1, 0, 0], KeyS: [-1, 0, 0], ArrowDown: [-1, 0, 0],
  KeyA: [0, 1, 0], ArrowLeft: [0, 1, 0], KeyD: [0, -1, 0], ArrowRight: [0, -1, 0],
  KeyQ: [0, 0, 1], KeyE: [0, 0, -1],
};

export class Keys {
  constructor(onChange) {
    this.down = new Set();
    this.onChange = onChange;
    addEventListener('keydown', (event) => this.press(event));
    addEventListener('keyup', (event) => this.lift(event));
  }

  press(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const known = event.code in WAYS || event.code === 'KeyR' || event.key === 'Shift';
    if (!known) return;
    event.preventDefault();
    if (event.repeat) return;
    this.down.add(event.key === 'Shift' ? 'Shift' : event.code);
    this.onChange();
  }

  lift(event) {
    this.down.delete(event.key === 'Shift' ? 'Shift' : event.code);
    this.onChange();
  }

  letGo() {
    this.down.clear();
    this.onChange();
  }

  get isHeld() {
    return [...this.down].some((code) => code in WAYS);
  }

  get turbo() {
    return this.down.has('Shift');
  }

  get reset() {
    return this.down.has('KeyR') && !this.isHeld;
  }

  // Forward, to the left, turning left, each in [-1, 1].
  get axes() {
    const sum = [0, 0, 0];
    for (const code of this.down) {
      (WAYS[code] ?? [0, 0, 0]).forEach((share, k) => { sum[k] += share; });
    }
    const size = Math.max(1, Math.hypot(sum[0], sum[1]));
    return [sum[0] / size, sum[1] / size, Math.max(-1, Math.min(1, sum[2]))];
  }
}

// Calls back when space or escape is pressed in a window, wherever the focus is.
export function onStopKey(target, callback) {
  target.addEventListener('keydown', (event) => {
    const types = event.target?.closest?.('input, textarea, [contenteditable]');
    if (event.code === 'Escape' || (event.code === 'Space' && !types)) {
      event.preventDefault();
      event.stopPropagation();
      if (!event.repeat) callback();
    }
  }, true);
}
