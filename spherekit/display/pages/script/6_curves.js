// Curves over the input, one figure for each quantity, one line for each assembly mode.

const figures = model.quantities.map(figureOf);

function shownUnit(unit) {
  return unit === "rad" ? [UNIT, SIGN] : [1, unit.replace(/([a-z])2/g, "$1²")];
}

function figureOf(quantity) {
  const [scale, unit] = shownUnit(quantity.unit), figure = document.createElement("figure");
  const caption = document.createElement("figcaption"), value = document.createElement("b");
  caption.append(`${quantity.label}${unit ? ` (${unit})` : ""}`, value);
  figure.append(caption);
  document.getElementById("plots").append(figure);
  return {quantity, scale, unit, figure, value, place: rows.place.get(quantity.name), plot: null};
}

function axis(more) {
  const faint = () => colour("--rule");
  return {stroke: () => colour("--soft"), grid: {stroke: faint, width: 1}, ticks: {stroke: faint, width: 1, size: 4}, font: "11px system-ui, sans-serif", ...more};
}

function plotOf(figure) {
  const made = new uPlot({
    width: figure.figure.clientWidth - 16, height: figures.length > 3 ? 130 : 158,
    legend: {show: false}, cursor: {show: false}, padding: [8, 16, 0, 0],
    scales: {x: {time: false}, y: {range: () => figure.range}},
    axes: [axis({size: 24, gap: 2}), axis({size: 46, gap: 3, space: 26})],
    series: [{}, ...modes.map((_, k) => ({stroke: () => modeColour(figure.curves[k].mode), points: {show: false}}))],
    hooks: {drawClear: [drawLimits], draw: [plot => drawCursor(plot, figure)]},
  }, [[0, 1], ...modes.map(() => [null, null])], figure.figure);
  made.over.tabIndex = 0;
  made.over.setAttribute("role", "img");
  made.over.setAttribute("aria-label", `${figure.quantity.label} over the input, of every assembly mode`);
  made.over.style.touchAction = "pan-y";
  const toInput = event => {
    const x = made.posToVal(event.clientX - made.over.getBoundingClientRect().left, "x");
    setInput(state.over, x * UNIT);
  };
  made.over.onpointerdown = event => { made.over.setPointerCapture(event.pointerId); pause(); toInput(event); };
  made.over.onpointermove = event => { if (made.over.hasPointerCapture(event.pointerId)) toInput(event); };
  made.over.onkeydown = keyed;
  return made;
}

// The range of a plot: of all modes, without what runs away where a mode ends. Numbers that
// differ by rounding alone are a constant, which is drawn level in the middle of its plot.

const CONSTANT = 1e-9;                     // part of a quantity's size that rounding may change

function rangeOf(columns, scale) {
  const numbers = columns.flat().filter(Number.isFinite).sort((a, b) => a - b);
  if (!numbers.length) return [-1, 1];
  const part = p => numbers[Math.round(p * (numbers.length - 1))];
  const margin = 0.75 * (part(0.96) - part(0.04));
  const low = Math.max(numbers[0], part(0.04) - margin), high = Math.min(numbers.at(-1), part(0.96) + margin);
  const size = Math.max(Math.abs(low), Math.abs(high)), rounding = CONSTANT * Math.max(size, scale);
  const room = high - low > rounding ? 0.06 * (high - low) : 0.1 * Math.max(size, scale) || 1;
  return [low - room, high + room];
}

function fillCurves() {
  const xs = [...new Set(modes.flatMap(mode => mode.curve.x))].sort((a, b) => a - b);
  const x = xs.map(value => value / UNIT);
  for (const figure of figures) {
    const columns = modes.map(({curve}) => aligned(xs, curve, figure.place, figure.scale));
    figure.range = rangeOf(columns, figure.quantity.size / figure.scale);
    const [low, high] = figure.range;
    figure.curves = orderCurves(columns, state.mode, high - low);
    figure.plot ??= plotOf(figure);
    figure.curves.forEach(({dash, width}, k) => Object.assign(figure.plot.series[k + 1], {dash, width}));
    figure.plot.setData([x, ...figure.curves.map(({mode}) => columns[mode])]);
  }
}

const CLOSE_SAMPLES = 1e-3;                // rad

function aligned(xs, {x, values}, place, scale) {
  const column = [], whole = (2 * Math.PI) / UNIT, wraps = scale === UNIT;
  let last = NaN;
  for (let k = 0, n = 0; k < xs.length; k++) {
    while (n < x.length && x[n] < xs[k]) n++;
    if (x[n] !== xs[k]) { column.push(undefined); continue; }
    const value = values[n] ? values[n][place] / scale : NaN;
    const jumps = wraps && Math.abs(value - last) > 0.5 * whole;  // an angle passes half a turn
    // Samples beside a meeting are so close together that a gap between them would not be seen.
    if (jumps && x[n] - x[n - 1] < CLOSE_SAMPLES) column[column.length - 1] = null;
    column.push(Number.isFinite(value) && !jumps ? value : null);
    last = value;
  }
  return column;
}

function drawCursor(plot, figure) {
  const {ctx, bbox: {left, top, width, height}} = plot, ratio = uPlot.pxRatio;
  const mark = modes[state.mode].curve;
  const across = x => plot.valToPos(x / UNIT, "x", true);
  ctx.save();
  ctx.beginPath();
  ctx.rect(left, top - 6 * ratio, width, height + 6 * ratio);
  ctx.clip();
  const upright = (x, tint, dash, wide) => {
    ctx.strokeStyle = tint;
    ctx.lineWidth = wide * ratio;
    ctx.setLineDash(dash.map(d => d * ratio));
    ctx.beginPath();
    ctx.moveTo(across(x), top);
    ctx.lineTo(across(x), top + height);
    ctx.stroke();
  };
  mark?.ends.forEach(x => upright(x, colour("--warn"), [4, 3], 1.2));
  mark?.meets.forEach(x => upright(x, colour("--fold"), [1, 3], 1.2));
  mark?.rests.forEach(x => upright(x, colour("--gold"), [2, 3], 1.2));
  upright(state.q[state.over], colour("--ink"), [], 1);
  ctx.setLineDash([]);
  modes.forEach((mode, k) => {
    const value = mode.here?.[figure.place];
    if (!Number.isFinite(value)) return;
    ctx.beginPath();
    ctx.arc(across(state.q[state.over]), plot.valToPos(value / figure.scale, "y", true), (k === state.mode ? 4.5 : 2.5) * ratio, 0, 2 * Math.PI);
    ctx.fillStyle = modeColour(k);
    ctx.fill();
    ctx.strokeStyle = colour("--card");
    ctx.lineWidth = 1.5 * ratio;
    ctx.stroke();
  });
  ctx.restore();
}

function drawLimits({ctx, bbox: {left, top, width, height}, valToPos}) {  // where the chosen mode is beyond joint limits
  const {beyond} = modes[state.mode].curve, across = x => clamp(valToPos(x / UNIT, "x", true), left, left + width);
  ctx.save();
  ctx.fillStyle = colour("--limit");
  ctx.globalAlpha = 0.18;
  for (const {from, to} of beyond) ctx.fillRect(across(from), top, across(to) - across(from), height);
  ctx.restore();
}

function resizeCurves() {
  for (const {plot, figure} of figures) plot?.setSize({width: figure.clientWidth - 16, height: plot.height});
}

// Numbers at the cursor.

const shownRows = model.quantities.map(({name, label, unit}) => {
  const row = document.querySelector("#values tbody").insertRow();
  const [scale, sign] = shownUnit(unit);
  row.append(Object.assign(document.createElement("th"), {scope: "row", textContent: label, title: name}));
  const value = row.insertCell();
  value.dataset.name = name;
  row.insertCell().textContent = sign;
  return {value, scale, place: rows.place.get(name)};
});

const limitRows = limits.map(limit => {
  const row = document.querySelector("#values tbody").insertRow(), value = row.cells;
  row.append(Object.assign(document.createElement("th"), {scope: "row", textContent: limitText(limit)}));
  row.insertCell();
  row.insertCell().textContent = SIGN;
  return {limit, row, value: value[1]};
});

function text(value, all = document.getElementById("digits").checked) {
  if (!Number.isFinite(value)) return "–";
  return all ? String(value) : String(+value.toPrecision(6));
}

function showNumbers() {
  const here = modes[state.mode].here;
  for (const {value, scale, place} of shownRows) {
    const number = here ? here[place] : NaN;
    value.textContent = text(number / scale);
    value.dataset.value = number;
  }
  for (const {limit, row, value} of limitRows) {
    const isKnown = here && !modes[state.mode].isSingular;
    value.textContent = text(isKnown ? angleNearLimits(limit, here, state.q) / UNIT : NaN);
    row.classList.toggle("beyond", Boolean(isKnown) && marginOf(limit, here, state.q) < 0);
  }
  for (const {value, place, scale} of figures) value.textContent = text(here ? here[place] / scale : NaN);
  clearTimeout(showNumbers.later);
  showNumbers.later = setTimeout(sayNumbers, 700);
}

function sayNumbers() {
  if (playing) return;
  const said = figures.map(({quantity, value, unit}) => `${quantity.label} ${value.textContent} ${unit}`);
  const at = inputs.map(({pair}, k) => `${pair} at ${text(state.q[k] / UNIT, false)} ${SIGN}`);
  const mode = modes[state.mode], status = statusText(mode) ? [statusText(mode)] : [];
  document.getElementById("said").textContent = [...at, ...status, ...(mode.here ? said : [])].join(", ");
}
