// What is shown: the inputs, sizes, assembly mode and view, kept in the page's link.

const model = JSON.parse(document.getElementById("model").textContent);
const DEG = Math.PI / 180;
const UNIT = model.angle_unit === "deg" ? DEG : 1;
const SIGN = model.angle_unit === "deg" ? "°" : "rad";

function kernel({about, at, step}) {
  const place = new Map(about.results.map((result, k) => [result.name, k]));
  const made = {about, at, step, place, count: about.results.length};
  made.motion = motionOf(made);
  return made;
}
const LISTS = ["q", "dq", "ddq"];
const inputs = model.inputs;
const rows = kernel(KERNELS.rows);         // at every sample of every mode
const picture = kernel(KERNELS.picture);   // at the cursor

const first = {
  q: inputs.map(input => input.from),
  dq: inputs.map(() => 1),
  ddq: inputs.map(() => 0),
  sizes: model.sizes.map(size => size.value),
  mode: 0, over: 0, moving: 0, step: -1, every: false, others: false,
  yaw: 0, pitch: 0, zoom: 1,
  theme: "", alone: false,
};
const state = structuredClone(first);
const changed = new Set(["all"]);          // what the next picture has to renew

function change(what, values = {}) {
  Object.assign(state, values);
  changed.add(what);
  wake();
}

function motionOf(kernel) {                // what a kernel's results follow from, by name
  const several = inputs.length > 1, places = new Map();
  for (const kind of LISTS) inputs.forEach(({pair}, k) => places.set(several ? `${kind}_${pair}` : kind, [kind, k]));
  const slots = kernel.about.motion.map(name => places.get(name)), given = slots.map(() => 0);
  return (q, turns) => {                   // `turns` (rad) of passive pairs, by the names of the arguments
    slots.forEach((slot, k) => {
      if (slot) given[k] = slot[0] === "q" ? q[slot[1]] : state[slot[0]][slot[1]];
      else given[k] = turns?.get(kernel.about.motion[k]) ?? 0;
    });
    return given;
  };
}

function inKernel(sizes) {                 // rad and SI, in the order of the kernel
  const of = new Map(model.sizes.map((size, k) => [size.key, sizes[k]]));
  return rows.about.sizes.map(({key, unit}) => of.get(key) * (unit === "rad" ? UNIT : 1));
}

const NUMBERS = ["mode", "over", "moving", "step", "yaw", "pitch", "zoom"];

function link() {
  const words = new URLSearchParams();
  for (const key of LISTS)
    if (state[key].some((x, k) => x !== first[key][k])) words.set(key, state[key].join());
  model.sizes.forEach((size, k) => {
    if (state.sizes[k] !== first.sizes[k]) words.set(size.key, state.sizes[k]);
  });
  for (const key of NUMBERS) if (state[key] !== first[key]) words.set(key, +state[key].toPrecision(6));
  for (const key of ["every", "others", "alone"]) if (state[key]) words.set(key, 1);
  if (state.theme) words.set("theme", state.theme);
  return words.toString();
}

function followLink() {
  const words = new URLSearchParams(location.hash.slice(1)), read = structuredClone(first);
  for (const key of LISTS) {
    const numbers = (words.get(key) ?? "").split(",").map(Number);
    if (words.has(key) && numbers.length === inputs.length && numbers.every(Number.isFinite))
      read[key] = numbers;
  }
  const number = key => (words.get(key)?.trim() ? Number(words.get(key)) : NaN);
  for (const key of NUMBERS) if (Number.isFinite(number(key))) read[key] = number(key);
  model.sizes.forEach(({key, least, most}, k) => {
    if (Number.isFinite(number(key))) read.sizes[k] = clamp(number(key), least, most);
  });
  read.q = read.q.map((x, k) => clamp(x, inputs[k].from, inputs[k].to));
  read.mode = clamp(Math.round(read.mode), 0, rows.about.modes.length - 1);
  read.over = clamp(Math.round(read.over), 0, inputs.length - 1);
  read.moving = clamp(Math.round(read.moving), 0, model.plans.length - 1);
  read.step = clamp(Math.round(read.step), -1, model.plans[read.moving].steps.length - 1);
  read.zoom = clamp(read.zoom, 0.4, 6);
  for (const key of ["every", "others", "alone"]) read[key] = words.has(key);
  if (["light", "dark"].includes(words.get("theme"))) read.theme = words.get("theme");
  change("all", read);
}

function clamp(x, low, high) {
  return Math.min(Math.max(x, low), high);
}
