// A stick under a finger: held while the finger is on it, let go when it is lifted or lost.

export class Stick {
  // element holds the knob; wide: only to the sides; onChange: called at every move.
  constructor(element, wide, onChange) {
    this.element = element;
    this.knob = element.querySelector('.knob');
    this.wide = wide;
    this.onChange = onChange;
    this.pointer = null;
    this.across = 0;  // to the right, in [-1, 1]
    this.up = 0;
    element.addEventListener('pointerdown', (event) => this.take(event));
    element.addEventListener('pointermove', (event) => this.move(event));
    for (const name of ['pointerup', 'pointercancel', 'lostpointercapture']) {
      element.addEventListener(name, (event) => this.lose(event));
    }
    element.addEventListener('contextmenu', (event) => event.preventDefault());
  }

  get isHeld() {
    return this.pointer !== null;
  }

  take(event) {
    if (this.isHeld || event.button !== 0) return;
    event.preventDefault();
    this.element.focus({preventScroll: true});
    this.element.setPointerCapture(event.pointerId);
    this.pointer = event.pointerId;
    this.move(event);
  }

  move(event) {
    if (event.pointerId !== this.pointer) return;
    const outside = event.clientX < 0 || event.clientY < 0
      || event.clientX >= innerWidth || event.clientY >= innerHeight;
    if (outside) {
      this.letGo();
      return;
    }
    const box = this.element.getBoundingClientRect();
    const reach = (box.width - this.knob.offsetWidth) / 2;
    this.show(
      (event.clientX - box.left - box.width / 2) / reach,
      this.wide ? 0 : (box.top + box.height / 2 - event.clientY) / reach,
    );
  }

  lose(event) {
    if (event.pointerId === this.pointer) this.letGo();
  }

  letGo() {
    const pointer = this.pointer;
    this.pointer = null;
    if (pointer !== null && this.element.hasPointerCapture(pointer)) {
      this.element.releasePointerCapture(pointer);
    }
    this.show(0, 0);
  }

  // Puts the knob where it is pushed, no farther than the rim.
  show(across, up) {
    const size = Math.max(1, Math.hypot(across, up));
    this.across = across / size;
    this.up = up / size;
    const box = this.element.getBoundingClientRect();
    const reach = (box.width - this.knob.offsetWidth) / 2;
    this.knob.style.transform =
      `translate(${this.across * reach}px, ${-this.up * reach}px)`;
    this.element.classList.toggle('held', this.isHeld);
    this.onChange();
  }
}
