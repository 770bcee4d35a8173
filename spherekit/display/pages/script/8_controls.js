// Controls: every one has a name, a key and a number beside it.

const element = id => document.getElementById(id);

function made(tag, properties = {}, ...children) {
  const one = Object.assign(document.createElement(tag), properties);
  one.append(...children);
  return one;
}

// A slider with a number beside it. The slider runs from min to max; the number may be any from
// `least` to `most`, and the slider then reaches that far.

function slider(key, unit, {min, max, step, least = min, most = max}, set, label = key) {
  const id = `of-${slider.count = (slider.count ?? 0) + 1}`;
  const range = made("input", {type: "range", min, max, step: "any", id});
  const number = made("input", {type: "number", step});
  number.setAttribute("aria-label", `${key} in ${unit === "°" ? "degrees" : unit || "its unit"}`);
  const row = made("div", {className: "row"}, made("label", {htmlFor: id, textContent: label, title: key}), range, number, made("span", {className: "unit", textContent: unit}));
  range.oninput = () => set(Number(range.value));
  range.onkeydown = event => {
    const way = {ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1}[event.key];
    if (!way) return;
    event.preventDefault();
    set(clamp(Number(range.value) + way * step * (event.shiftKey ? 10 : 1), Number(range.min), Number(range.max)));
  };
  const written = value => +value.toPrecision(7);
  const control = {row, range, number, shown: NaN, show(value) {
    if (value < Number(range.min)) range.min = value;
    if (value > Number(range.max)) range.max = value;
    if (this.shown === value) return;
    this.shown = range.value = value;
    if (document.activeElement !== number || Number(number.value) !== value) number.value = written(value);
  }};
  number.onchange = () => {                // what is no number there goes back to the one before
    const isNumber = number.value.trim() && Number.isFinite(number.valueAsNumber);
    const value = isNumber ? clamp(number.valueAsNumber, least, most) : control.shown;
    if (!isNumber || value !== number.valueAsNumber) number.value = written(value);
    if (isNumber) set(value);
  };
  return control;
}

const drives = inputs.map(({pair, from, to}, k) => {
  const one = slider(`input ${pair}`, SIGN, {min: from / UNIT, max: to / UNIT, step: UNIT === 1 ? 0.01 : 1}, value => { pause(); setInput(k, value * UNIT); });
  element("drive").append(one.row);
  return one;
});

const play = made("button", {id: "play", type: "button", textContent: "▶"});
play.setAttribute("aria-label", "Play");
play.onclick = () => (playing ? pause() : start());
drives[0].row.classList.add("played");
drives[0].row.prepend(play);

function rateField(key, k, label, unit) {
  const field = made("input", {type: "number", step: "any", value: state[key][k]});
  field.onchange = () => {
    if (!Number.isFinite(field.valueAsNumber)) field.value = state[key][k];
    change("sizes", {[key]: state[key].with(k, field.valueAsNumber)});
  };
  return {key, k, field, row: made("label", {}, `${label} `, field, ` ${unit}`)};
}

const rates = model.moving ? inputs.flatMap(({pair}, k) => {
  const of = several ? ` of ${pair}` : "";
  return [rateField("dq", k, `rate${of}`, "rad/s"), rateField("ddq", k, `acceleration${of}`, "rad/s²")];
}) : [];
if (rates.length) element("drive").append(made("div", {className: "rates"}, ...rates.map(({row}) => row)));

const sizes = model.sizes.map(({key, unit, low, high, least, most, step}, k) => {
  const one = slider(key, unit === "rad" ? SIGN : unit, {min: low, max: high, least, most, step}, value => change("sizes", {sizes: state.sizes.with(k, value)}), key.replace(/^pairs\./, "").replace(/^links/, "link").replaceAll(".", " "));
  element("sliders").append(one.row);
  return one;
});
element("sizes").hidden = !sizes.length;

const choices = modes.map((mode, k) => {
  const radio = made("input", {type: "radio", name: "mode", value: k});
  radio.onchange = () => change("mode", {mode: k});
  const label = made("label", {}, radio, made("i"), mode.name);
  element("modes").append(label);
  return {radio, label};
});

const others = made("input", {type: "checkbox"});
others.onchange = () => change("others", {others: others.checked});
if (modes.length > 1) element("over").append(made("label", {}, others, " all modes on the sphere"));

function chooser(place, label, names, key, what) {
  if (names.length < 2) return;
  const list = made("select", {}, ...names.map((text, k) => made("option", {value: k, textContent: text})));
  list.onchange = () => change(what, {[key]: Number(list.value)});
  element(place).append(made("label", {}, `${label} `, list));
  return list;
}

const over = chooser("over", "curves over", inputs.map(({pair}) => `input ${pair}`), "over", "sizes");
const moving = chooser("moving", "while one input moves:", model.plans.map(({moves}) => moves), "moving", "plan");

function showControls() {
  drives.forEach((one, k) => {
    one.show(state.q[k] / UNIT);
    one.row.classList.toggle("gone", !modes[state.mode].here);
  });
  sizes.forEach((one, k) => {
    one.show(state.sizes[k]);
    one.row.classList.toggle("changed", state.sizes[k] !== first.sizes[k]);
  });
  rates.forEach(({key, k, field}) => { if (document.activeElement !== field) field.value = state[key][k]; });
  choices.forEach(({radio, label}, k) => {
    radio.checked = k === state.mode;
    label.style.setProperty("--shade", modeColour(k));
    label.classList.toggle("gone", !modes[k].here);
    label.title = modes[k].here ? "" : "does not close here";
  });
  others.checked = state.others;
  if (over) over.value = state.over;
  if (model.crossings) element("crossings").textContent = crossingsText();
  if (moving) moving.value = state.moving;
  element("lost").textContent = statusText(modes[state.mode]);
  element("lost").classList.toggle("beyond", Boolean(modes[state.mode].here));
  element("lost").classList.toggle("singular", modes[state.mode].isSingular);
}

function statusText(mode) {
  if (!mode.here) return "assembly lost";
  const isNear = x => Math.abs(x - state.q[mode.curve.over]) < 1e-4;
  if (mode.isSingular) return mode.curve.meets.some(isNear) ? "modes meet here" : "at a dead centre";
  return beyondText(mode.here, state.q);
}

function setInput(k, value) {
  change("input", {q: state.q.with(k, clamp(value, inputs[k].from, inputs[k].to))});
}

function nudge(k, steps) {
  pause();
  setInput(k, state.q[k] + steps * (UNIT === 1 ? 0.01 : DEG));
}

// The sphere under the hand: a knob moves its input, all else turns the view.

let held = null;
const fingers = new Map();

function knobAt(event) {
  const box = canvas.getBoundingClientRect();
  if (!shown) return -1;
  const reachOf = event.pointerType === "touch" ? 26 : 15;
  return inputs.findIndex((input, k) => {
    const [x, y] = seen(knobOf(k).far);
    return Math.hypot(event.clientX - box.left - x, event.clientY - box.top - y) < reachOf;
  });
}

function under(event, behind) {
  const box = canvas.getBoundingClientRect();
  return pointAt(event.clientX - box.left, event.clientY - box.top, behind);
}

canvas.onpointerdown = event => {
  canvas.setPointerCapture(event.pointerId);
  canvas.focus({preventScroll: true});
  fingers.set(event.pointerId, event);
  const knob = fingers.size === 1 ? knobAt(event) : -1;
  held = {knob, x: event.clientX, y: event.clientY, apart: 0};
  if (knob >= 0) {
    pause();
    const {axis, far, sense} = knobOf(knob);
    Object.assign(held, {axis, sense, behind: seen(far)[2] < 0, q: state.q[knob]});
    held.last = under(event, held.behind);
  }
  canvas.classList.toggle("held", knob < 0);
};

canvas.onpointermove = event => {
  if (!held) { canvas.classList.toggle("knob", knobAt(event) >= 0); return; }
  fingers.set(event.pointerId, event);
  if (fingers.size === 2) return pinch();
  if (held.knob >= 0) return turnKnob(event);
  const angle = 1 / sight.radius;
  change("view", {
    yaw: state.yaw - (event.clientX - held.x) * angle,
    pitch: clamp(state.pitch + (event.clientY - held.y) * angle, -1.57, 1.57),
  });
  Object.assign(held, {x: event.clientX, y: event.clientY});
};

canvas.onpointerup = canvas.onpointercancel = event => {
  fingers.delete(event.pointerId);
  held = null;
  canvas.classList.remove("held");
};

function turnKnob(event) {
  const {axis, last, sense, behind, knob} = held, next = under(event, behind);
  const flat = a => plus(a, scaled(axis, -dot(a, axis)));
  held.q += sense * Math.atan2(dot(axis, cross(flat(last), flat(next))), dot(flat(last), flat(next)));
  held.last = next;
  const {from, to} = inputs[knob];
  const whole = to - from > 2 * Math.PI - 1e-9;
  if (whole && held.q < from) { held.q += to - from; passTurn(-1); }
  if (whole && held.q > to) { held.q -= to - from; passTurn(1); }
  setInput(knob, held.q);
}

function passTurn(way) {                   // a smooth curve may need several turns to close
  const mode = modeAfterTurn(modes[state.mode], way, toKernelSizes(state.sizes));
  if (mode !== state.mode) change("mode", {mode});
}

function pinch() {
  const [a, b] = [...fingers.values()], apart = Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY);
  if (held.apart) zoomBy(apart / held.apart);
  held.apart = apart;
}

function zoomBy(factor) {
  change("view", {zoom: clamp(state.zoom * factor, 0.4, 6)});
}

canvas.addEventListener("wheel", event => {
  event.preventDefault();
  zoomBy(Math.exp(-event.deltaY / 600));
}, {passive: false});

const turn = (yaw, pitch) => change("view", {yaw: state.yaw + yaw, pitch: clamp(state.pitch + pitch, -1.57, 1.57)});
const KEYS = {
  ArrowLeft: () => turn(-0.08, 0), ArrowRight: () => turn(0.08, 0), ArrowUp: () => turn(0, 0.08), ArrowDown: () => turn(0, -0.08),
  "+": () => zoomBy(1.15), "=": () => zoomBy(1.15), "-": () => zoomBy(1 / 1.15),
  ",": () => nudge(state.over, -1), ".": () => nudge(state.over, 1), "<": () => nudge(state.over, -10), ">": () => nudge(state.over, 10),
  " ": () => play.click(), n: () => stepBy(1), p: () => stepBy(-1), m: () => change("mode", {mode: (state.mode + 1) % modes.length}),
};

function keyed(event) {
  const act = KEYS[event.key] ?? KEYS[event.key.toLowerCase()];
  if (!act || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  act();
}

canvas.onkeydown = keyed;
element("nearer").onclick = () => zoomBy(1.2);
element("farther").onclick = () => zoomBy(1 / 1.2);
element("home").onclick = () => change("view", {yaw: first.yaw, pitch: first.pitch, zoom: 1});

// The page's buttons: link, file, first state, colours.

async function copied(words) {
  try { await navigator.clipboard.writeText(words); } catch {
    const area = made("textarea", {value: words});
    document.body.append(area);
    area.select();
    document.execCommand("copy");
    area.remove();
  }
}

element("copy").onclick = async event => {
  keepLink();
  await copied(location.href);
  event.target.textContent = "Copied";
  setTimeout(() => { event.target.textContent = "Copy link"; }, 1500);
};

function toml() {
  const written = x => (Number.isInteger(x) && Math.abs(x) < 1e15 ? x.toFixed(1) : String(x));
  return model.toml.map(part => (typeof part === "number" ? written(state.sizes[part]) : part)).join("");
}

element("save").onclick = () => {
  showNow();
  const url = URL.createObjectURL(new Blob([toml()], {type: "application/toml"}));
  made("a", {href: url, download: `${model.name}.toml`}).click();
  setTimeout(() => URL.revokeObjectURL(url), 10000);
};

element("reset").onclick = () => { pause(); change("all", {...structuredClone(first), theme: state.theme}); };
element("theme").onclick = () => change("theme", {theme: dark() ? "light" : "dark"});
element("digits").onchange = () => change("input");
