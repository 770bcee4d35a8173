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
const DASH_PX = 10;                        // length of a dash of lines that coincide
const CHOSEN_WIDTH_PX = 3;                 // of curves of the chosen mode
const OTHER_WIDTH_PX = 1.4;
const EQUAL_CURVES = 4e-3;                 // part of a plot's height by which curves that coincide differ: half a pixel
const DARK_THEME_LIGHTNESS = 0.32;         // part of white that is mixed to colours on a dark page
const REUSED_LIGHTNESS = 0.3;              // part of white that is mixed to colours that are used once more
const MAX_LIGHTNESS = 0.7;

/** Returns the colour of a mode by its index. From the 33rd mode on, colours are used again, lighter. */
function modeColour(index) {
  const round = Math.floor(index / MODE_COLOURS.length);
  const colour = MODE_COLOURS[index % MODE_COLOURS.length];
  const lightness = (isDark() ? DARK_THEME_LIGHTNESS : 0) + REUSED_LIGHTNESS * (1 - 0.5 ** round);
  return mixWithGrey(colour, 255, Math.min(lightness, MAX_LIGHTNESS));
}

/**
 * Returns the dash [line, gap] (pixels) of one of several lines that coincide.
 * @param position - Position of the line in the order of drawing; the one at 0 is solid.
 * @param count - Number of lines that coincide.
 */
function coincidentDash(position, count) {
  return position ? [DASH_PX * (count - position), DASH_PX * position] : [];
}

/**
 * Returns the curves of all modes in the order of drawing, with their dashes and widths. Curves that
 * coincide form a group. Its first curve is solid and closes wherever one of the others does. The
 * others are dashed on it. The group of the chosen mode is drawn last and wider.
 * @param columns - For each mode its numbers over the same inputs: null where the mode does not
 *   close, undefined where it has no sample.
 * @param chosen - Index of the chosen mode.
 * @param height - Range of the plot, in the unit of the numbers.
 * @returns [{mode, dash, width}] - The index of a mode, and pixels.
 */
function orderCurves(columns, chosen, height) {
  const sampleCounts = columns.map(column => column.filter(Number.isFinite).length);
  // Curves with more samples come first, and of equal ones the chosen mode, so that it is solid.
  const order = [...columns.keys()].sort((a, b) => sampleCounts[b] - sampleCounts[a] || (b === chosen) - (a === chosen));
  const groups = [];
  for (const mode of order) {
    const group = groups.find(([base]) => isOnCurve(columns[base], columns[mode], EQUAL_CURVES * height));
    if (group) group.push(mode);
    else groups.push([mode]);
  }
  groups.sort((a, b) => a.includes(chosen) - b.includes(chosen));

  const curves = [];
  for (const group of groups) {
    const width = group.includes(chosen) ? CHOSEN_WIDTH_PX : OTHER_WIDTH_PX;
    group.forEach((mode, position) => curves.push({mode, dash: coincidentDash(position, group.length), width}));
  }
  return curves;
}

/**
 * Returns whether a curve coincides with another one wherever it closes.
 * @param base, column - Numbers of the other curve and of the curve, as in `orderCurves`.
 * @param tolerance - In the unit of the numbers.
 */
function isOnCurve(base, column, tolerance) {
  let commonCount = 0;
  for (let k = 0; k < base.length; k++) {
    if (!Number.isFinite(column[k]) || base[k] === undefined) continue;
    if (base[k] === null || !(Math.abs(base[k] - column[k]) <= tolerance)) return false;
    commonCount += 1;
  }
  return commonCount > 1;                  // curves that share one sample only may cross there
}
