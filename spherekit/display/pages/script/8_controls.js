// Controls: every one has a name, a key and a number beside it.

const INPUT_SLIDER_STEP = UNIT === 1 ? 0.01 : 1;  // for one press of a key, in the unit of the file
const KEY_STEP_RAD = UNIT === 1 ? 0.01 : DEG;  // of inputs, for one press of a key
const FAST_KEY_STEPS = 10;                 // steps of an arrow key with shift on a slider
const SHOWN_DIGITS = 7;                    // of numbers in fields
const MARK_TOLERANCE_RAD = 1e-4;           // between the input and the meeting that the status names
const KNOB_REACH_PX = 15;                  // from a knob to a pointer that takes it
const KNOB_TOUCH_REACH_PX = 26;
const MAX_PITCH_RAD = 1.57;                // just below a right angle, so that up stays up
const LEAST_ZOOM = 0.4;
const MOST_ZOOM = 6;
const WHEEL_E_FOLD_PX = 600;               // of a wheel, by which the zoom changes by a factor of e
const KEY_TURN_RAD = 0.08;
const KEY_ZOOM = 1.15;
const BUTTON_ZOOM = 1.2;
const WHOLE_TURN_RAD = 2 * Math.PI - 1e-9;  // ranges at least as long are whole turns, in spite of rounding
const COPIED_MS = 1500;                    // how long a button says that the link is copied
const FILE_LIFETIME_MS = 10000;            // until the browser may forget a saved file

const elementById = id => document.getElementById(id);

/** Returns a new element with some properties and children. */
function makeElement(tag, properties = {}, ...children) {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
}

// Sliders

let sliderCount = 0;

/**
 * Returns a slider with a number beside it.
 * @param key - Name of the value, for screen readers.
 * @param unit - Unit that is shown.
 * @param range - {min, max, step, least, most} in that unit. The slider runs from min to max. The
 *   number may be any from `least` to `most`, and the slider then reaches that far.
 * @param setValue - Called with each new value.
 * @param label - Text before the slider.
 * @returns {row, show} - The element, and a function that shows a value.
 */
function makeSlider(key, unit, {min, max, step, least = min, most = max}, setValue, label = key) {
  sliderCount += 1;
  const id = `of-${sliderCount}`;
  const slider = makeElement("input", {type: "range", min, max, step: "any", id});
  const field = makeElement("input", {type: "number", step});
  field.setAttribute("aria-label", `${key} in ${unit === "°" ? "degrees" : unit || "its unit"}`);
  const labelElement = makeElement("label", {htmlFor: id, textContent: label, title: key});
  const unitElement = makeElement("span", {className: "unit", textContent: unit});
  const row = makeElement("div", {className: "row"}, labelElement, slider, field, unitElement);
  let shownValue = NaN;
  const toFieldValue = value => +value.toPrecision(SHOWN_DIGITS);

  function show(value) {
    if (value < Number(slider.min)) slider.min = value;
    if (value > Number(slider.max)) slider.max = value;
    if (shownValue === value) return;
    shownValue = value;
    slider.value = value;
    // A number that is being typed is not replaced by an equal one.
    const isBeingTyped = document.activeElement === field && Number(field.value) === value;
    if (!isBeingTyped) field.value = toFieldValue(value);
  }

  slider.oninput = () => setValue(Number(slider.value));
  slider.onkeydown = event => {
    const direction = {ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1}[event.key];
    if (!direction) return;
    event.preventDefault();
    const value = Number(slider.value) + direction * step * (event.shiftKey ? FAST_KEY_STEPS : 1);
    setValue(clamp(value, Number(slider.min), Number(slider.max)));
  };
  field.onchange = () => {                 // text that is no number goes back to the number before it
    const isNumber = field.value.trim() && Number.isFinite(field.valueAsNumber);
    const value = isNumber ? clamp(field.valueAsNumber, least, most) : shownValue;
    if (!isNumber || value !== field.valueAsNumber) field.value = toFieldValue(value);
    if (isNumber) setValue(value);
  };
  return {row, show};
}

const inputSliders = inputs.map(({pair, from, to}, k) => {
  const range = {min: from / UNIT, max: to / UNIT, step: INPUT_SLIDER_STEP};
  const slider = makeSlider(`input ${pair}`, SIGN, range, value => {
    pause();
    setInput(k, value * UNIT);
  });
  elementById("drive").append(slider.row);
  return slider;
});

const playButton = makeElement("button", {id: "play", type: "button", textContent: "▶"});
playButton.setAttribute("aria-label", "Play");
playButton.onclick = () => (isPlaying ? pause() : play());
inputSliders[0].row.classList.add("played");
inputSliders[0].row.prepend(playButton);

/**
 * Returns a field for the rate or acceleration of an input.
 * @param key - "dq" or "ddq", the list of the state.
 * @param k - Index of the input.
 */
function makeRateField(key, k, label, unit) {
  const field = makeElement("input", {type: "number", step: "any", value: state[key][k]});
  field.onchange = () => {
    if (!Number.isFinite(field.valueAsNumber)) field.value = state[key][k];
    change("sizes", {[key]: state[key].with(k, field.valueAsNumber)});
  };
  return {key, k, field, row: makeElement("label", {}, `${label} `, field, ` ${unit}`)};
}

const rateFields = [];
if (model.moving) {
  inputs.forEach(({pair}, k) => {
    const suffix = hasSeveralInputs ? ` of ${pair}` : "";
    rateFields.push(makeRateField("dq", k, `rate${suffix}`, "rad/s"));
    rateFields.push(makeRateField("ddq", k, `acceleration${suffix}`, "rad/s²"));
  });
  elementById("drive").append(makeElement("div", {className: "rates"}, ...rateFields.map(({row}) => row)));
}

/** Returns the key of a size in words, such as "link 2 arc" for "links.2.arc". */
const sizeLabel = key => key.replace(/^pairs\./, "").replace(/^links/, "link").replaceAll(".", " ");

const sizeSliders = model.sizes.map(({key, unit, low, high, least, most, step}, k) => {
  const range = {min: low, max: high, least, most, step};
  const setSize = value => change("sizes", {sizes: state.sizes.with(k, value)});
  const slider = makeSlider(key, unit === "rad" ? SIGN : unit, range, setSize, sizeLabel(key));
  elementById("sliders").append(slider.row);
  return slider;
});
elementById("sizes").hidden = !sizeSliders.length;

// Choices

const modeChoices = modes.map((mode, k) => {
  const radio = makeElement("input", {type: "radio", name: "mode", value: k});
  radio.onchange = () => change("mode", {mode: k});
  const label = makeElement("label", {}, radio, makeElement("i"), mode.name);
  elementById("modes").append(label);
  return {radio, label};
});

const othersCheckbox = makeElement("input", {type: "checkbox"});
othersCheckbox.onchange = () => change("others", {others: othersCheckbox.checked});
if (modes.length > 1) elementById("over").append(makeElement("label", {}, othersCheckbox, " all modes on the sphere"));

/**
 * Adds a list of choices to the page if there are several.
 * @param parentId - Element to which it is added.
 * @param key - Number of the state that is the index of the chosen one.
 * @param kind - Kind of the change.
 * @returns The list, or undefined if there is one choice.
 */
function addSelect(parentId, label, choices, key, kind) {
  if (choices.length < 2) return undefined;
  const options = choices.map((text, k) => makeElement("option", {value: k, textContent: text}));
  const select = makeElement("select", {}, ...options);
  select.onchange = () => change(kind, {[key]: Number(select.value)});
  elementById(parentId).append(makeElement("label", {}, `${label} `, select));
  return select;
}

const overSelect = addSelect("over", "curves over", inputs.map(({pair}) => `input ${pair}`), "over", "sizes");
const movingSelect = addSelect("moving", "while one input moves:", model.plans.map(({moves}) => moves), "moving", "plan");

/** Shows the state in all controls, and the status of all modes. */
function showControls() {
  const chosenMode = modes[state.mode];
  inputSliders.forEach((slider, k) => {
    slider.show(state.q[k] / UNIT);
    slider.row.classList.toggle("gone", !chosenMode.results);
  });
  sizeSliders.forEach((slider, k) => {
    slider.show(state.sizes[k]);
    slider.row.classList.toggle("changed", state.sizes[k] !== first.sizes[k]);
  });
  for (const {key, k, field} of rateFields)
    if (document.activeElement !== field) field.value = state[key][k];
  modeChoices.forEach(({radio, label}, k) => {
    radio.checked = k === state.mode;
    label.style.setProperty("--shade", modeColour(k));
    label.classList.toggle("gone", !modes[k].results);
    label.title = modes[k].results ? "" : "does not close here";
  });
  othersCheckbox.checked = state.others;
  if (overSelect) overSelect.value = state.over;
  if (model.crossings) elementById("crossings").textContent = crossingsText();
  if (movingSelect) movingSelect.value = state.moving;
  elementById("lost").textContent = statusText(chosenMode);
  elementById("lost").classList.toggle("beyond", Boolean(chosenMode.results));
  elementById("lost").classList.toggle("singular", chosenMode.isSingular);
}

/** Returns in words whether a mode is lost, singular, or beyond a limit at the inputs; empty if none. */
function statusText(mode) {
  if (!mode.results) return "assembly lost";
  if (mode.isSingular) {
    const isNear = x => Math.abs(x - state.q[mode.curve.over]) < MARK_TOLERANCE_RAD;
    return mode.curve.meets.some(isNear) ? "modes meet here" : "at a dead centre";
  }
  return beyondText(mode.results, state.q);
}

/** Sets an input (rad), or the end of its range that is nearest to the value. */
function setInput(k, value) {
  change("input", {q: state.q.with(k, clamp(value, inputs[k].from, inputs[k].to))});
}

/** Moves an input by a number of key steps. */
function nudge(k, steps) {
  pause();
  setInput(k, state.q[k] + steps * KEY_STEP_RAD);
}

// Pointers on the sphere: a knob moves its input, everything else turns the view.

// The drag in progress, or null: {knobIndex, x, y, pinchDistance}, in pixels of the window, and, for a
// knob (index not -1), {axis, sense, isBehind, input, point}: the direction under the pointer is `point`.
let drag = null;
const pointerEvents = new Map();           // the last event of each pointer that is down, by its id

/** Returns the index of the input whose knob is at a pointer, -1 if there is none. */
function knobIndexAt(event) {
  if (!drawnConfiguration) return -1;
  const box = canvas.getBoundingClientRect();
  const reach = event.pointerType === "touch" ? KNOB_TOUCH_REACH_PX : KNOB_REACH_PX;
  return inputs.findIndex((input, k) => {
    const [x, y] = projectPoint(knobGeometry(k).knob);
    return Math.hypot(event.clientX - box.left - x, event.clientY - box.top - y) < reach;
  });
}

/** Returns the direction under a pointer, on the hemisphere in front or behind. */
function directionAt(event, isBehind) {
  const box = canvas.getBoundingClientRect();
  return unprojectPixel(event.clientX - box.left, event.clientY - box.top, isBehind);
}

canvas.onpointerdown = event => {
  canvas.setPointerCapture(event.pointerId);
  canvas.focus({preventScroll: true});
  pointerEvents.set(event.pointerId, event);
  const knobIndex = pointerEvents.size === 1 ? knobIndexAt(event) : -1;
  drag = {knobIndex, x: event.clientX, y: event.clientY, pinchDistance: 0};
  if (knobIndex >= 0) {
    pause();
    const {axis, knob, sense} = knobGeometry(knobIndex);
    const isBehind = projectPoint(knob)[2] < 0;
    Object.assign(drag, {axis, sense, isBehind, input: state.q[knobIndex], point: directionAt(event, isBehind)});
  }
  canvas.classList.toggle("held", knobIndex < 0);
};

canvas.onpointermove = event => {
  if (!drag) {
    canvas.classList.toggle("knob", knobIndexAt(event) >= 0);
    return;
  }
  pointerEvents.set(event.pointerId, event);
  if (pointerEvents.size === 2) {
    zoomByPinch();
  } else if (drag.knobIndex >= 0) {
    turnKnob(event);
  } else {
    // The point in the middle of the sphere follows the pointer.
    const anglePerPixel = 1 / projection.radius;
    turnView(-(event.clientX - drag.x) * anglePerPixel, (event.clientY - drag.y) * anglePerPixel);
    drag.x = event.clientX;
    drag.y = event.clientY;
  }
};

function endDrag(event) {
  pointerEvents.delete(event.pointerId);
  drag = null;
  canvas.classList.remove("held");
}

canvas.onpointerup = endDrag;
canvas.onpointercancel = endDrag;

/** Turns the input of the dragged knob by the angle of the pointer about its axis since the last event. */
function turnKnob(event) {
  const {axis, sense, isBehind, knobIndex} = drag;
  const point = directionAt(event, isBehind);
  const lastArm = rejectFrom(axis, drag.point);
  const arm = rejectFrom(axis, point);
  drag.input += sense * Math.atan2(dot(axis, cross(lastArm, arm)), dot(lastArm, arm));
  drag.point = point;
  const {from, to} = inputs[knobIndex];
  // A knob of a whole turn goes on at the other end of the range.
  if (isWholeTurn(inputs[knobIndex]) && drag.input < from) {
    drag.input += to - from;
    passTurn(-1);
  }
  if (isWholeTurn(inputs[knobIndex]) && drag.input > to) {
    drag.input -= to - from;
    passTurn(1);
  }
  setInput(knobIndex, drag.input);
}

const isWholeTurn = ({from, to}) => to - from > WHOLE_TURN_RAD;

/** Chooses the mode that goes on after a turn of the input. A smooth curve may need several turns to close. */
function passTurn(direction) {
  const mode = modeAfterTurn(modes[state.mode], direction, toKernelSizes(state.sizes));
  if (mode !== state.mode) change("mode", {mode});
}

/** Zooms by the change of the distance between two pointers. */
function zoomByPinch() {
  const [a, b] = [...pointerEvents.values()];
  const distance = Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY);
  if (drag.pinchDistance) zoomBy(distance / drag.pinchDistance);
  drag.pinchDistance = distance;
}

function zoomBy(factor) {
  change("view", {zoom: clamp(state.zoom * factor, LEAST_ZOOM, MOST_ZOOM)});
}

/** Turns the view by angles (rad) to the left and upwards. */
function turnView(yaw, pitch) {
  change("view", {yaw: state.yaw + yaw, pitch: clamp(state.pitch + pitch, -MAX_PITCH_RAD, MAX_PITCH_RAD)});
}

canvas.addEventListener("wheel", event => {
  event.preventDefault();
  zoomBy(Math.exp(-event.deltaY / WHEEL_E_FOLD_PX));
}, {passive: false});

// Keys on the sphere and on the plots

const actionByKey = {
  ArrowLeft: () => turnView(-KEY_TURN_RAD, 0),
  ArrowRight: () => turnView(KEY_TURN_RAD, 0),
  ArrowUp: () => turnView(0, KEY_TURN_RAD),
  ArrowDown: () => turnView(0, -KEY_TURN_RAD),
  "+": () => zoomBy(KEY_ZOOM),
  "=": () => zoomBy(KEY_ZOOM),
  "-": () => zoomBy(1 / KEY_ZOOM),
  ",": () => nudge(state.over, -1),
  ".": () => nudge(state.over, 1),
  "<": () => nudge(state.over, -FAST_KEY_STEPS),
  ">": () => nudge(state.over, FAST_KEY_STEPS),
  " ": () => playButton.click(),
  n: () => stepBy(1),
  p: () => stepBy(-1),
  m: () => change("mode", {mode: (state.mode + 1) % modes.length}),
};

function handleKey(event) {
  const action = actionByKey[event.key] ?? actionByKey[event.key.toLowerCase()];
  if (!action || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  action();
}

canvas.onkeydown = handleKey;
elementById("nearer").onclick = () => zoomBy(BUTTON_ZOOM);
elementById("farther").onclick = () => zoomBy(1 / BUTTON_ZOOM);
elementById("home").onclick = () => change("view", {yaw: first.yaw, pitch: first.pitch, zoom: 1});

// The buttons of the page: link, file, first state, colours

/** Copies a text to the clipboard. */
async function copyText(text) {
  try {
    await navigator.clipboard.writeText(text);
  } catch {
    // If the clipboard is refused, the text is copied as a selection.
    const area = makeElement("textarea", {value: text});
    document.body.append(area);
    area.select();
    document.execCommand("copy");
    area.remove();
  }
}

elementById("copy").onclick = async event => {
  keepLink();
  await copyText(location.href);
  event.target.textContent = "Copied";
  setTimeout(() => { event.target.textContent = "Copy link"; }, COPIED_MS);
};

/** Returns the file of the mechanism with the sizes of the page, as text. */
function writeToml() {
  // In a TOML file whole numbers need a decimal point to be floats.
  const formatFloat = x => (Number.isInteger(x) && Math.abs(x) < 1e15 ? x.toFixed(1) : String(x));
  return model.toml.map(part => (typeof part === "number" ? formatFloat(state.sizes[part]) : part)).join("");
}

elementById("save").onclick = () => {
  updateNow();
  const url = URL.createObjectURL(new Blob([writeToml()], {type: "application/toml"}));
  makeElement("a", {href: url, download: `${model.name}.toml`}).click();
  setTimeout(() => URL.revokeObjectURL(url), FILE_LIFETIME_MS);
};

elementById("reset").onclick = () => {
  pause();
  change("all", {...structuredClone(first), theme: state.theme});
};
elementById("theme").onclick = () => change("theme", {theme: isDark() ? "light" : "dark"});
elementById("digits").onchange = () => change("input");
