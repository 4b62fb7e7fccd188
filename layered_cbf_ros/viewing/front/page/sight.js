// What the page shows: the connection, who steers, the chips, the figures, the stop.

const LATE_MS = 300;
const LOST_MS = 1000;
const WORD_MS = 3000;
const of = (id) => document.getElementById(id);
const SPECIAL = [['*all', 'all'], ['*formation', 'formation'], ['*release', 'give back']];

export class Sight {
  // choose: called with the name of the chip that is pressed.
  constructor(choose) {
    this.choose = choose;
    this.control = 'free';
    this.figures = {time: null, robots: [], stopped: false, paused: false, operator: ''};
    this.chosen = '';
    this.wordAt = -Infinity;
    this.movedAt = performance.now();
  }

  hear(beat) {
    this.control = beat.control;
    if (beat.word) this.say(beat.word);
    if (!beat.figures) return;
    if (beat.figures.time !== this.figures.time) this.movedAt = performance.now();
    this.figures = beat.figures;
    document.body.classList.toggle('watching', !beat.steers);
    this.showChips();
    this.showFigures();
  }

  say(word) {
    this.wordAt = performance.now();
    of('word').textContent = word;
    of('word').hidden = word === '';
  }

  // Shows what changes by itself; age is that of the connection [ms].
  show(age, held) {
    const now = performance.now();
    if (now - this.wordAt > WORD_MS) of('word').hidden = true;
    of('link').dataset.state = age < LATE_MS ? 'good' : age < LOST_MS ? 'late' : 'lost';
    const seconds = Number.isFinite(age) ? `${(age / 1000).toFixed(1)} s` : '';
    of('link-word').textContent = age < LATE_MS ? 'connected' : `no answer ${seconds}`;
    of('control').textContent = this.whoSteers(age, held);
    of('control').dataset.who = age < LOST_MS ? this.control : 'lost';
    document.body.classList.toggle('stopped', this.figures.stopped);
    of('reset').classList.toggle('held', held.reset);
    this.showBanner(age, now - this.movedAt);
  }

  whoSteers(age, held) {
    if (age >= LOST_MS) return 'No connection';
    if (this.control === 'yours') return held.reset ? 'You reset the stop' : 'You steer';
    if (this.control === 'other') return 'Another page steers';
    if (this.figures.operator && !this.figures.operator.endsWith('/viewer')) {
      return `${this.figures.operator} steers`;
    }
    return 'Hold the stick to steer';
  }

  showBanner(age, still) {
    const {time, stopped, paused} = this.figures;
    let text = '';
    if (age >= LOST_MS) text = 'No connection: who was steered from here has been stopped';
    else if (stopped) text = 'EMERGENCY STOP: everybody brakes and sits down';
    else if (time === null) text = 'Waiting for a run';
    else if (paused) text = `Paused at ${time.toFixed(3)} s`;
    else if (still > 2000) text = `No news from the run for ${(still / 1000).toFixed(0)} s`;
    of('banner').textContent = text;
    of('banner').hidden = text === '';
    of('banner').dataset.kind = stopped || age >= LOST_MS ? 'stop' : 'news';
  }

  showChips() {
    const names = this.figures.robots.map((robot) => robot.name);
    const wanted = [...names.map((name) => [name, name]),
      ...SPECIAL.filter(([key]) => names.length > 1 || key === '*release')];
    if (of('chips').childElementCount !== wanted.length) {
      of('chips').replaceChildren(...wanted.map(([key, label]) => this.chip(key, label)));
    }
    const steered = this.figures.robots.map((robot) => robot.steered);
    const everybody = names.length > 1 && steered.every(Boolean);
    for (const chip of of('chips').children) {
      const robot = names.indexOf(chip.dataset.key);
      const on = robot >= 0 ? steered[robot] : everybody && chip.dataset.key === this.chosen;
      chip.setAttribute('aria-pressed', String(on));
    }
  }

  chip(key, label) {
    const chip = document.createElement('button');
    chip.dataset.key = key;
    chip.textContent = label;
    chip.addEventListener('click', () => {
      this.chosen = key;
      this.choose(key);
    });
    return chip;
  }

  // The figures are those of who is steered, else of the robot that was chosen, else of the first.
  showFigures() {
    const robots = this.figures.robots;
    const shown = robots.find((robot) => robot.steered)
      ?? robots.find((robot) => robot.name === this.chosen) ?? robots[0];
    const put = (id, value, digits) => {
      of(id).textContent = value === null || value === undefined ? '–' : value.toFixed(digits);
    };
    put('speed', shown?.speed, 2);
    put('h', shown?.h, 2);
    put('intervention', shown?.intervention, 2);
    of('other').textContent = shown?.other ? `m to ${shown.other}` : 'm';
    const near = shown?.h ?? Infinity;
    of('h').dataset.level = near < 0.1 ? 'near' : near < 0.5 ? 'close' : 'far';
    of('intervention').dataset.level = (shown?.intervention ?? 0) > 0.05 ? 'close' : 'far';
    of('time').textContent =
      this.figures.time === null ? '' : `${this.figures.time.toFixed(1)} s`;
  }
}
