// The operator's page: joins the stick, the keys and the buttons to the team.

import {Keys, onStopKey} from '/page/keys.js';
import {Link} from '/page/link.js';
import {Sight} from '/page/sight.js';
import {Stick} from '/page/stick.js';

const PRESSED_MS = 250;  // a tap counts so long: some messages hold it
const of = (id) => document.getElementById(id);

// The token of the address is in a cookie now; it needn't be seen or bookmarked.
history.replaceState(null, '', location.pathname);

let link = null;
const changed = () => link?.say(held());
const stick = new Stick(of('stick'), false, changed);
const yaw = new Stick(of('yaw'), true, changed);
const keys = new Keys(changed);
const taps = {choose: '', chooseUntil: 0, stopUntil: 0, resets: false, turbo: false};

// Returns all that is held at this moment.
function held() {
  const now = performance.now();
  const [forward, left, turn] = keys.axes;
  const enable = stick.isHeld || yaw.isHeld || keys.isHeld;
  const stops = now < taps.stopUntil;
  return {
    x: stick.isHeld ? stick.up : forward,
    y: stick.isHeld ? -stick.across : left,
    yaw: yaw.isHeld ? -yaw.across : turn,
    enable: enable && !stops,
    turbo: taps.turbo || keys.turbo,
    e_stop: stops,
    reset: (taps.resets || keys.reset) && !enable && !stops,
    choose: now < taps.chooseUntil ? taps.choose : '',
  };
}

function letGo() {
  taps.resets = false;
  stick.letGo();
  yaw.letGo();
  keys.letGo();
}

function choose(name) {
  taps.choose = name;
  taps.chooseUntil = performance.now() + PRESSED_MS;
  changed();
}

// Stops everybody, on two ways: one of them may be stuck.
function stop() {
  letGo();
  taps.stopUntil = performance.now() + PRESSED_MS;
  changed();
  fetch('/e_stop', {method: 'POST', keepalive: true})
    .catch(() => sight.say('no connection: the stop was not heard'));
}

const sight = new Sight(choose);
link = new Link(held, (beat) => sight.hear(beat));

of('stop').addEventListener('pointerdown', stop);
of('stop').addEventListener('click', stop);  // by a screen reader or the enter key
onStopKey(window, stop);
// The focus may be in the scene; it may have been there before this script, or come later.
const guardScene = () => onStopKey(of('scene').contentWindow, stop);
of('scene').addEventListener('load', guardScene);
if (of('scene').contentDocument?.readyState === 'complete') guardScene();

of('turbo').addEventListener('click', () => {
  taps.turbo = !taps.turbo;
  of('turbo').setAttribute('aria-pressed', String(taps.turbo));
  changed();
});

of('reset').addEventListener('pointerdown', (event) => {
  of('reset').setPointerCapture(event.pointerId);
  taps.resets = true;
  changed();
});
for (const name of ['pointerup', 'pointercancel', 'lostpointercapture']) {
  of('reset').addEventListener(name, () => {
    taps.resets = false;
    changed();
  });
}

// A page that nobody looks at holds nothing.
addEventListener('blur', letGo);
addEventListener('pagehide', () => {
  letGo();
  link.close();
});
document.addEventListener('visibilitychange', () => {
  if (document.hidden) letGo();
});
// From the cache of the browser it would come back without a connection.
addEventListener('pageshow', (event) => {
  if (event.persisted) location.reload();
});

setInterval(() => sight.show(link.age, held()), 100);
