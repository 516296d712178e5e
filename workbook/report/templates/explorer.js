"use strict";
const id = name => document.getElementById(name);

// The state is kept in the address, so that a link restores it. Browsers refuse many changes of it in a second.
let keeping = 0;
function keep(state) {
  clearTimeout(keeping);
  keeping = setTimeout(() => {
    keeping = 0;
    history.replaceState(null, "", `#${new URLSearchParams(state)}`);
  }, 200);
}
function kept() { return Object.fromEntries(new URLSearchParams(location.hash.slice(1))); }

// Round numbers within an axis, and their labels.
function ticks(low, high, most) {
  const rough = (high - low) / most, power = 10 ** Math.floor(Math.log10(rough)), step = power * [1, 2, 5, 10].find(each => each * power >= rough * (1 - 1e-9));
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9)), first = Math.ceil(low / step - 1e-9), last = Math.floor(high / step + 1e-9);
  return Array.from({length: last - first + 1}, (_, k) => (first + k) * step).map(at => [at, (Math.abs(at) < step / 2 ? 0 : at).toFixed(digits)]);
}
function text(x, y, label, anchor = "middle", name = "") { return `<text x="${x}" y="${y}" text-anchor="${anchor}" class="${name}">${label}</text>`; }
