// Curves over the input: one figure for each quantity, one line for each assembly mode. The numbers
// at the cursor are at the end.

const RANGE_QUANTILE = 0.04;               // part of the samples beyond each end of the usual values of a curve
const RANGE_MARGIN = 0.75;                 // part of the span of usual values that a plot shows beyond them
const CONSTANT = 1e-9;                     // part of a quantity's size that rounding may change
const CURVE_PADDING = 0.06;                // part of the span of a curve above and below it
const CONSTANT_PADDING = 0.1;              // part of the size of a constant above and below it
const CLOSE_SAMPLES_RAD = 1e-3;            // between samples; a gap between nearer ones would not be seen
const MANY_FIGURES = 4;                    // from this number of figures on they are lower
const PLOT_HEIGHT_PX = 174;
const LOW_PLOT_HEIGHT_PX = 146;
const AXIS_LABEL_PX = 15;                  // height of the name of the input below a plot
// Steps of ticks that divide a revolution. Angles in radians have decimal ones.
const DEGREE_TICK_STEPS = [0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 45, 60, 90, 180, 360, 720, 1800, 3600];
const FIGURE_PADDING_PX = 16;              // width of a figure beside its plot
const ANNOUNCEMENT_DELAY_MS = 700;         // from the last change to the text for screen readers
const SHORT_DIGITS = 6;

const figures = model.quantities.map(makeFigure);

/** Returns [scale, unit]: numbers of the kernel are divided by the scale and shown in the unit. */
function displayUnit(unit) {
  return unit === "rad" ? [UNIT, SIGN] : [1, unit.replace(/([a-z])2/g, "$1²")];
}

/**
 * Adds an empty figure for a quantity to the page.
 * @returns The figure: `value` is the element of the number at the cursor, `place` the index of the
 *   quantity in a row, and `plot`, `range` and `curves` are filled by `fillCurves`.
 */
function makeFigure(quantity) {
  const [scale, unit] = displayUnit(quantity.unit);
  const figure = document.createElement("figure");
  const caption = document.createElement("figcaption");
  const value = document.createElement("b");
  caption.append(`${quantity.label}${unit ? ` (${unit})` : ""}`, value);
  figure.append(caption);
  document.getElementById("plots").append(figure);
  return {quantity, scale, unit, figure, value, place: rows.place.get(quantity.name), plot: null};
}

/** Returns uPlot's options of an axis in the colours of the theme. */
function makeAxisOptions(options) {
  const ruleColour = () => themeColour("--rule");
  return {
    stroke: () => themeColour("--soft"),
    grid: {stroke: ruleColour, width: 1},
    ticks: {stroke: ruleColour, width: 1, size: 4},
    font: "11px system-ui, sans-serif",
    ...options,
  };
}

/** Returns the name of the input over which the curves are drawn, with its unit. */
const inputLabel = () => `input ${inputs[state.over].pair} (${SIGN})`;

/** Returns the plot of a figure. Dragging in it moves the input, and keys act as on the sphere. */
function makePlot(figure) {
  const inputAxis = {size: 22, gap: 2, label: inputLabel(), labelSize: AXIS_LABEL_PX, labelGap: -2, labelFont: "11px system-ui, sans-serif"};
  if (SIGN === "°") inputAxis.incrs = DEGREE_TICK_STEPS;
  const options = {
    width: figure.figure.clientWidth - FIGURE_PADDING_PX,
    height: figures.length >= MANY_FIGURES ? LOW_PLOT_HEIGHT_PX : PLOT_HEIGHT_PX,
    legend: {show: false},
    cursor: {show: false},
    padding: [8, 16, 0, 0],
    scales: {x: {time: false}, y: {range: () => figure.range}},
    axes: [makeAxisOptions(inputAxis), makeAxisOptions({size: 46, gap: 3, space: 26})],
    // Lines are in the order of drawing, which changes, so each asks for the colour of its mode.
    series: [{}, ...modes.map((_, k) => ({stroke: () => modeColour(figure.curves[k].mode), points: {show: false}}))],
    hooks: {drawClear: [drawLimits], draw: [plot => drawMarks(plot, figure)]},
  };
  const emptyData = [[0, 1], ...modes.map(() => [null, null])];
  const plot = new uPlot(options, emptyData, figure.figure);

  const area = plot.over;
  area.tabIndex = 0;
  area.setAttribute("role", "img");
  area.setAttribute("aria-label", `${figure.quantity.label} over the input, of every assembly mode`);
  area.style.touchAction = "pan-y";
  const moveInput = event => {
    const x = plot.posToVal(event.clientX - area.getBoundingClientRect().left, "x");
    setInput(state.over, x * UNIT);
  };
  area.onpointerdown = event => {
    area.setPointerCapture(event.pointerId);
    pause();
    moveInput(event);
  };
  area.onpointermove = event => {
    if (area.hasPointerCapture(event.pointerId)) moveInput(event);
  };
  area.onkeydown = handleKey;
  return plot;
}

/**
 * Returns the range [low, high] of a plot. It shows all modes, but not values far from the usual
 * ones, which run away where a mode ends. Numbers that differ by rounding alone are a constant, which
 * is drawn level in the middle of its plot.
 * @param columns - Numbers of each mode in the shown unit; those that are not finite have no effect.
 * @param size - Natural size of the quantity in the shown unit.
 */
function plotRange(columns, size) {
  const numbers = columns.flat().filter(Number.isFinite).sort((a, b) => a - b);
  if (!numbers.length) return [-1, 1];
  const quantile = part => numbers[Math.round(part * (numbers.length - 1))];
  const usualLow = quantile(RANGE_QUANTILE);
  const usualHigh = quantile(1 - RANGE_QUANTILE);
  const margin = RANGE_MARGIN * (usualHigh - usualLow);
  const low = Math.max(numbers[0], usualLow - margin);
  const high = Math.min(numbers.at(-1), usualHigh + margin);
  const largest = Math.max(Math.abs(low), Math.abs(high), size);
  const isConstant = !(high - low > CONSTANT * largest);
  const padding = isConstant ? CONSTANT_PADDING * largest || 1 : CURVE_PADDING * (high - low);
  return [low - padding, high + padding];
}

/** Puts the curves of all modes into the plots. */
function fillCurves() {
  // Modes have samples of their own at their ends. All curves of a plot need the same inputs.
  const allInputs = [...new Set(modes.flatMap(mode => mode.curve.x))].sort((a, b) => a - b);
  const shownInputs = allInputs.map(x => x / UNIT);
  for (const figure of figures) {
    const columns = modes.map(({curve}) => alignColumn(allInputs, curve, figure.place, figure.scale));
    figure.range = plotRange(columns, figure.quantity.size / figure.scale);
    const [low, high] = figure.range;
    figure.curves = orderCurves(columns, state.mode, high - low);
    figure.plot ??= makePlot(figure);
    figure.curves.forEach(({dash, width}, k) => Object.assign(figure.plot.series[k + 1], {dash, width}));
    figure.plot.axes[0].label = inputLabel();
    figure.plot.setData([shownInputs, ...figure.curves.map(({mode}) => columns[mode])]);
  }
}

/**
 * Returns a quantity of one curve at the inputs of all curves, in the shown unit. It is undefined
 * where the curve has no sample, and null where it breaks off.
 * @param allInputs - Rising inputs (rad), among them all those of the curve.
 * @param curve - Curve of a mode.
 * @param place - Index of the quantity in a row.
 * @param scale - The unit in which the quantity is shown; `UNIT` for angles.
 */
function alignColumn(allInputs, {x, values}, place, scale) {
  const column = [];
  const wholeTurn = (2 * Math.PI) / UNIT;
  const isAngle = scale === UNIT;
  let lastValue = NaN;
  let n = 0;                               // index of the next sample of the curve
  for (const input of allInputs) {
    while (n < x.length && x[n] < input) n++;
    if (x[n] !== input) {
      column.push(undefined);
      continue;
    }
    const value = values[n] ? values[n][place] / scale : NaN;
    // An angle that passes half a turn goes on at minus half a turn: no line joins the two.
    const isJump = isAngle && Math.abs(value - lastValue) > 0.5 * wholeTurn;
    // Samples beside a meeting are so close together that a gap between them would not be seen.
    if (isJump && x[n] - x[n - 1] < CLOSE_SAMPLES_RAD) column[column.length - 1] = null;
    column.push(Number.isFinite(value) && !isJump ? value : null);
    lastValue = value;
  }
  return column;
}

/** Draws the marks of the chosen mode, the cursor, and a dot for each mode on a plot. */
function drawMarks(plot, figure) {
  const {ctx, bbox: {left, top, width, height}} = plot;
  const ratio = uPlot.pxRatio;
  const {curve} = modes[state.mode];
  const toPixel = x => plot.valToPos(x / UNIT, "x", true);
  const drawUpright = (x, tint, dash, lineWidth) => {
    ctx.strokeStyle = tint;
    ctx.lineWidth = lineWidth * ratio;
    ctx.setLineDash(dash.map(length => length * ratio));
    ctx.beginPath();
    ctx.moveTo(toPixel(x), top);
    ctx.lineTo(toPixel(x), top + height);
    ctx.stroke();
  };
  ctx.save();
  ctx.beginPath();
  ctx.rect(left, top - 6 * ratio, width, height + 6 * ratio);  // with room for a dot at the upper edge
  ctx.clip();
  curve?.ends.forEach(x => drawUpright(x, themeColour("--warn"), [4, 3], 1.2));
  curve?.meets.forEach(x => drawUpright(x, themeColour("--fold"), [1, 3], 1.2));
  curve?.rests.forEach(x => drawUpright(x, themeColour("--gold"), [2, 3], 1.2));
  drawUpright(state.q[state.over], themeColour("--ink"), [], 1);
  ctx.setLineDash([]);
  modes.forEach((mode, k) => {
    const value = mode.results?.[figure.place];
    if (!Number.isFinite(value)) return;
    const radius = (k === state.mode ? 4.5 : 2.5) * ratio;
    ctx.beginPath();
    ctx.arc(toPixel(state.q[state.over]), plot.valToPos(value / figure.scale, "y", true), radius, 0, 2 * Math.PI);
    ctx.fillStyle = modeColour(k);
    ctx.fill();
    ctx.strokeStyle = themeColour("--card");
    ctx.lineWidth = 1.5 * ratio;
    ctx.stroke();
  });
  ctx.restore();
}

/** Shades the inputs at which the chosen mode is beyond joint limits, below the curves of a plot. */
function drawLimits({ctx, bbox: {left, top, width, height}, valToPos}) {
  const {curve} = modes[state.mode];
  const toPixel = x => clamp(valToPos(x / UNIT, "x", true), left, left + width);
  ctx.save();
  ctx.fillStyle = themeColour("--limit");
  ctx.globalAlpha = 0.18;
  for (const {from, to} of curve.beyond) ctx.fillRect(toPixel(from), top, toPixel(to) - toPixel(from), height);
  ctx.restore();
}

/** Fits the plots to the width of their figures. */
function resizeCurves() {
  for (const {plot, figure} of figures) plot?.setSize({width: figure.clientWidth - FIGURE_PADDING_PX, height: plot.height});
}

// Numbers at the cursor

let announcementTimer = 0;

/** Adds a row to the table of numbers: a heading and empty cells for the value and the unit. */
function addNumberRow(heading) {
  const tableRow = document.querySelector("#values tbody").insertRow();
  tableRow.append(Object.assign(document.createElement("th"), {scope: "row", ...heading}));
  return {tableRow, valueCell: tableRow.insertCell(), unitCell: tableRow.insertCell()};
}

const quantityRows = model.quantities.map(({name, label, unit}) => {
  const [scale, shownUnit] = displayUnit(unit);
  const {valueCell, unitCell} = addNumberRow({textContent: label, title: name});
  valueCell.dataset.name = name;
  unitCell.textContent = shownUnit;
  return {valueCell, scale, place: rows.place.get(name)};
});

const limitRows = limits.map(limit => {
  const {tableRow, valueCell, unitCell} = addNumberRow({textContent: limitText(limit)});
  unitCell.textContent = SIGN;
  return {limit, tableRow, valueCell};
});

/** Returns a number as text, with all digits or rounded to some; a dash if it is not finite. */
function formatNumber(value, hasAllDigits = document.getElementById("digits").checked) {
  if (!Number.isFinite(value)) return "–";
  return hasAllDigits ? String(value) : String(+value.toPrecision(SHORT_DIGITS));
}

/** Shows the numbers of the chosen mode in the table and the captions, and announces them a little later. */
function showNumbers() {
  const mode = modes[state.mode];
  const {results} = mode;
  for (const {valueCell, scale, place} of quantityRows) {
    const value = results ? results[place] : NaN;
    valueCell.textContent = formatNumber(value / scale);
    valueCell.dataset.value = value;
  }
  for (const {limit, tableRow, valueCell} of limitRows) {
    const isKnown = Boolean(results) && !mode.isSingular;
    valueCell.textContent = formatNumber(isKnown ? angleNearLimits(limit, results, state.q) / UNIT : NaN);
    tableRow.classList.toggle("beyond", isKnown && marginOf(limit, results, state.q) < 0);
  }
  for (const {value, place, scale} of figures) value.textContent = formatNumber(results ? results[place] / scale : NaN);
  clearTimeout(announcementTimer);
  announcementTimer = setTimeout(announceNumbers, ANNOUNCEMENT_DELAY_MS);
}

/** Writes inputs, status and numbers as a text for screen readers. While the page plays, it is silent. */
function announceNumbers() {
  if (isPlaying) return;
  const mode = modes[state.mode];
  const parts = inputs.map(({pair}, k) => `${pair} at ${formatNumber(state.q[k] / UNIT, false)} ${SIGN}`);
  const status = statusText(mode);
  if (status) parts.push(status);
  if (mode.results)
    for (const {quantity, value, unit} of figures) parts.push(`${quantity.label} ${value.textContent} ${unit}`);
  document.getElementById("said").textContent = parts.join(", ");
}
