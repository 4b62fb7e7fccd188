// The connection to the team: says thirty times a second what is held, hears how it goes.

const HELD_MS = 1000 / 30;
const IDLE_MS = 200;
const AGAIN_MS = 500;   // until a lost connection is tried again
const DEAD_MS = 2000;   // without a beat: a new connection is tried
const FAREWELL = 5;     // messages that say that all was let go

export class Link {
  // held: () => what is held now; onBeat: called with each beat of the server.
  constructor(held, onBeat) {
    this.held = held;
    this.onBeat = onBeat;
    this.number = 0;
    this.answers = -1;
    this.heardAt = -Infinity;
    this.farewell = 0;
    this.saidAt = -Infinity;
    this.open();
    setInterval(() => this.turn(), HELD_MS);
  }

  // How long nothing was heard [ms].
  get age() {
    return performance.now() - this.heardAt;
  }

  open() {
    const socket = new WebSocket(location.origin.replace(/^http/, 'ws') + '/operator');
    this.socket = socket;
    this.openedAt = performance.now();
    this.number = 0;
    socket.onmessage = (event) => {
      const beat = JSON.parse(event.data);
      this.answers = beat.beat;
      this.heardAt = performance.now();
      this.onBeat(beat);
    };
    socket.onclose = () => {
      if (socket === this.socket) setTimeout(() => this.open(), AGAIN_MS);
    };
  }

  // Says what is held if it is time to; an idle page only shows that it is there.
  turn() {
    const now = performance.now();
    if (this.age > DEAD_MS && now - this.openedAt > DEAD_MS) {
      const dead = this.socket;
      this.open();
      dead.close();
    }
    const held = this.held();
    const busy = held.enable || held.reset || held.e_stop || held.choose !== '';
    if (busy) this.farewell = FAREWELL;
    if (busy || this.farewell > 0 || now - this.saidAt >= IDLE_MS) this.say(held);
    if (!busy && this.farewell > 0) this.farewell -= 1;
  }

  // Says at once what is held; what can't be sent now is not sent later.
  say(held) {
    if (this.socket.readyState !== WebSocket.OPEN || this.socket.bufferedAmount > 0) return;
    this.saidAt = performance.now();
    this.number += 1;
    this.socket.send(JSON.stringify({number: this.number, answers: this.answers, ...held}));
  }

  close() {
    this.socket.close();
  }
}
