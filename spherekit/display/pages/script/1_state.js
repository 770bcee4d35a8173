// The state of the page: inputs, sizes, assembly mode and view. It is kept in the page's link.
//
// Angles are in rad, except sizes, which are in the unit of the file. A kernel is a set of
// exported formulas. Its results for one configuration are a row: one number for each result.

const model = JSON.parse(document.getElementById("model").textContent);
const DEG = Math.PI / 180;
const UNIT = model.angle_unit === "deg" ? DEG : 1;       // unit of angles of the file, in rad
const SIGN = model.angle_unit === "deg" ? "°" : "rad";

// A kernel with `place`, the index of each result by name, and `count`, the number of results.

function makeKernel({about, at, step}) {
  const place = new Map(about.results.map((result, index) => [result.name, index]));
  const kernel = {about, at, step, place, count: about.results.length};
  kernel.motion = makeMotionArguments(kernel);
  return kernel;
}

const LISTS = ["q", "dq", "ddq"];          // inputs, their rates and accelerations in the state
const inputs = model.inputs;
const rows = makeKernel(KERNELS.rows);         // evaluated at every sample of every mode
const picture = makeKernel(KERNELS.picture);   // evaluated at the cursor

const first = {                            // the state without a link
  q: inputs.map(input => input.from),
  dq: inputs.map(() => 1),
  ddq: inputs.map(() => 0),
  sizes: model.sizes.map(size => size.value),
  mode: 0, over: 0, moving: 0, step: -1, every: false, others: false,
  yaw: 0, pitch: 0, zoom: 1,
  theme: "", alone: false,
};
const state = structuredClone(first);
const changed = new Set(["all"]);          // kinds of changes that the next picture has to show

function change(kind, values = {}) {
  Object.assign(state, values);
  changed.add(kind);
  wake();
}

// A function that returns the array of motion arguments of a kernel, in its order. Its arguments
// are the inputs, and the whole turns (rad) of passive pairs by the names of the arguments. Rates
// and accelerations are those of the state. The array is the same at each call.

function makeMotionArguments(kernel) {
  const hasSeveralInputs = inputs.length > 1;
  const sourceByName = new Map();          // name of an argument: [list of the state, index of the input]
  for (const list of LISTS)
    inputs.forEach(({pair}, index) => {
      const name = hasSeveralInputs ? `${list}_${pair}` : list;
      sourceByName.set(name, [list, index]);
    });
  const names = kernel.about.motion;
  const sources = names.map(name => sourceByName.get(name));
  const motion = sources.map(() => 0);
  return (q, turns) => {
    sources.forEach((source, k) => {
      if (!source) {                       // whole turns of a passive pair
        motion[k] = turns?.get(names[k]) ?? 0;
        return;
      }
      const [list, index] = source;
      motion[k] = list === "q" ? q[index] : state[list][index];
    });
    return motion;
  };
}

function toKernelSizes(sizes) {            // from the order and units of sliders to those of the kernel
  const sizeByKey = new Map(model.sizes.map((size, index) => [size.key, sizes[index]]));
  return rows.about.sizes.map(({key, unit}) => sizeByKey.get(key) * (unit === "rad" ? UNIT : 1));
}

const NUMBERS = ["mode", "over", "moving", "step", "yaw", "pitch", "zoom"];
const SWITCHES = ["every", "others", "alone"];

function link() {                          // the state as text, without what is as at first
  const parameters = new URLSearchParams();
  for (const list of LISTS)
    if (state[list].some((x, index) => x !== first[list][index])) parameters.set(list, state[list].join());
  model.sizes.forEach((size, index) => {
    if (state.sizes[index] !== first.sizes[index]) parameters.set(size.key, state.sizes[index]);
  });
  for (const key of NUMBERS)
    if (state[key] !== first[key]) parameters.set(key, +state[key].toPrecision(6));
  for (const key of SWITCHES) if (state[key]) parameters.set(key, 1);
  if (state.theme) parameters.set("theme", state.theme);
  return parameters.toString();
}

function followLink() {                    // read the state; numbers that are not allowed are moved to the nearest
  const parameters = new URLSearchParams(location.hash.slice(1));
  const newState = structuredClone(first);
  for (const list of LISTS) {
    const numbers = (parameters.get(list) ?? "").split(",").map(Number);
    if (parameters.has(list) && numbers.length === inputs.length && numbers.every(Number.isFinite))
      newState[list] = numbers;
  }
  const number = key => (parameters.get(key)?.trim() ? Number(parameters.get(key)) : NaN);
  for (const key of NUMBERS) if (Number.isFinite(number(key))) newState[key] = number(key);
  model.sizes.forEach(({key, least, most}, index) => {
    if (Number.isFinite(number(key))) newState.sizes[index] = clamp(number(key), least, most);
  });
  const lastIndex = list => list.length - 1;
  newState.q = newState.q.map((x, index) => clamp(x, inputs[index].from, inputs[index].to));
  newState.mode = clamp(Math.round(newState.mode), 0, lastIndex(rows.about.modes));
  newState.over = clamp(Math.round(newState.over), 0, lastIndex(inputs));
  newState.moving = clamp(Math.round(newState.moving), 0, lastIndex(model.plans));
  newState.step = clamp(Math.round(newState.step), -1, lastIndex(model.plans[newState.moving].steps));
  newState.zoom = clamp(newState.zoom, 0.4, 6);
  for (const key of SWITCHES) newState[key] = parameters.has(key);
  if (["light", "dark"].includes(parameters.get("theme"))) newState.theme = parameters.get("theme");
  change("all", newState);
}

function clamp(x, low, high) {
  return Math.min(Math.max(x, low), high);
}
