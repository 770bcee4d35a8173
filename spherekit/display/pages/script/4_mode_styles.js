// Colours and dashes of assembly modes. Every mode has a colour of its own; lines of modes that
// coincide are dashed in turn, so that the colours of all of them are seen.

// The first eight are those of Okabe and Ito. Each of the others is the one farthest from all
// before it in Oklab, of medium lightness: no two are nearer than 0.1 there.
const MODE_COLOURS = [
  "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#5b4fa2", "#7a5a2f",
  "#c300ff", "#0000ff", "#b40069", "#78c300", "#8778ff", "#ff00b4", "#004b5a", "#870000",
  "#006900", "#7800f0", "#780078", "#968700", "#ff004b", "#3c0fb4", "#96b487", "#a54bb4",
  "#e169ff", "#3c5aff", "#c30f00", "#7887b4", "#ff7869", "#a55a69", "#007869", "#693c5a",
];
const DASH = 10;                           // pixels of a dash of lines that coincide
const CHOSEN_WIDTH = 3;
const OTHER_WIDTH = 1.4;
const EQUAL_CURVES = 4e-3;                 // part of a plot's height: half a pixel

function modeColour(k) {
  const round = Math.floor(k / MODE_COLOURS.length), colour = MODE_COLOURS[k % MODE_COLOURS.length];
  const lightness = (dark() ? 0.32 : 0) + 0.3 * (1 - 0.5 ** round);  // the 33rd mode and on
  return mixed(colour, 255, Math.min(lightness, 0.7));
}

function dashOf(place, count) {            // of the line `place` of `count` that coincide, drawn in this order
  return place ? [DASH * (count - place), DASH * place] : [];
}

// The curves in the order of drawing, each {mode, dash, width}, from columns of numbers over the same inputs: null
// where a mode does not close, undefined where it has no sample. Curves that coincide form a group.
// The first of a group is solid and closes wherever one of the others does, which are dashed on it.
// The group of the chosen mode is drawn last and wider.

function orderCurves(columns, chosen, height) {
  const samples = columns.map(column => column.filter(Number.isFinite).length);
  const order = [...columns.keys()].sort((a, b) => samples[b] - samples[a] || (b === chosen) - (a === chosen)), groups = [];
  for (const k of order) {
    const group = groups.find(([first]) => liesOn(columns[first], columns[k], EQUAL_CURVES * height));
    if (group) group.push(k); else groups.push([k]);
  }
  groups.sort((one, other) => one.includes(chosen) - other.includes(chosen));
  return groups.flatMap(group => group.map((mode, place) => ({
    mode, dash: dashOf(place, group.length), width: group.includes(chosen) ? CHOSEN_WIDTH : OTHER_WIDTH,
  })));
}

function liesOn(base, other, tolerance) {  // whether a curve coincides with another all along
  let both = 0;
  for (let k = 0; k < base.length; k++) {
    if (!Number.isFinite(other[k]) || base[k] === undefined) continue;
    if (!(Math.abs(base[k] - other[k]) <= tolerance) || base[k] === null) return false;
    both += 1;
  }
  return both > 1;
}
