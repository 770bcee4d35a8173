// Poles: the Table, its steps in order, and the two great circles that find a pole.

const table = document.getElementById("table");
const plan = () => model.plans[state.moving];
const poleOf = (row, [a, b]) => xyz(row, `pole_${a}_${b}`, plan().end);
const inFront = point => (dot(point, sight.eye) < 0 ? scaled(point, -1) : point);

function buildTable() {
  const {titles, cells, bodies} = plan(), body = document.createElement("tbody");
  const head = document.createElement("tr");
  head.append(document.createElement("td"), ...titles.map(text => heading(text, "col")));
  const lines = cells.map((marks, i) => {
    const row = document.createElement("tr");
    row.append(heading(titles[i], "row"), ...marks.map((mark, j) => cell(mark, bodies[i], bodies[j])));
    return row;
  });
  body.append(head, ...lines);
  table.tBodies[0]?.remove();
  table.append(body);
}

function heading(text, scope) {
  return Object.assign(document.createElement("th"), {textContent: text, scope});
}

function cell(mark, a, b) {
  const place = document.createElement("td");
  const step = plan().steps.findIndex(({poles}) => poles.some(pole => samePole(pole, [a, b])));
  if (a === b || step < 0) { place.textContent = mark; return place; }
  const button = Object.assign(document.createElement("button"), {type: "button", textContent: mark});
  button.setAttribute("aria-label", `Pole of ${a} and ${b}: ${mark}`);
  button.dataset.pole = JSON.stringify([a, b]);
  button.onclick = () => change("step", {step: state.step === step ? -1 : step});
  place.append(button);
  return place;
}

const samePole = ([a, b], [c, d]) => (a === c && b === d) || (a === d && b === c);

function showStep() {
  const step = plan().steps[state.step];
  for (const button of table.querySelectorAll("button")) {
    const pole = JSON.parse(button.dataset.pole), hand = step?.poles.some(x => samePole(x, pole));
    button.classList.toggle("hand", Boolean(hand));
    button.classList.toggle("source", Boolean(!hand && step?.lines.flat().some(x => samePole(x, pole))));
    button.setAttribute("aria-pressed", Boolean(hand));
  }
  document.getElementById("step").textContent = step
    ? `${state.step + 1} of ${plan().steps.length}: ${step.text}`
    : `${plan().steps.length} steps give every pole; choose one, or a cell of the Table.`;
  document.getElementById("every").checked = state.every;
}

function drawPoles(row) {
  const step = plan().steps[state.step], shown = new Map();
  if (state.every)
    for (const {poles} of plan().steps) for (const pole of poles) shown.set(String(pole), ["bronze", pole]);
  if (step) {
    for (const pole of step.lines.flat()) shown.set(String(pole), ["source", pole]);
    for (const pole of step.poles) shown.set(String(pole), ["hand", pole]);
    for (const ends of step.lines) greatCircle(poleOf(row, ends[0]), poleOf(row, ends[1]));
    for (const pair of step.contacts) greatCircle(poleOf(row, step.poles[0]), contactOf(row, pair));
  }
  return [...shown.values()].map(([kind, pole]) => ({kind, pole, at: inFront(poleOf(row, pole))}));
}

function greatCircle(a, b) {
  const normal = cross(a, b);
  if (Math.hypot(...normal) > 1e-9) line(circle(unitOf(normal), Math.PI / 2), colour("--fold"), 1.4, {dash: [7, 4], faint: 0.45});
}

function contactOf(row, name) {            // the nearest points of the two profiles
  const pair = model.pairs.find(x => x.name === name);
  const [one, other] = pair.links.map(link => {
    const profile = model.links[linkNumber.get(link)].profiles.find(x => x.pair === name);
    return profile.curve.map(point => turned(frameOf(row, link), point));
  });
  let best = -1, touch = one[0];
  for (const a of one) for (const b of other) if (dot(a, b) > best) { best = dot(a, b); touch = unitOf(plus(a, b)); }
  return touch;
}

function markPoles(poles) {
  for (const {kind, pole, at} of poles) {
    const hand = kind === "hand", tint = kind === "bronze" ? (dark() ? "#a5863a" : "#7a6222") : hand ? colour("--gold") : colour("--fold");
    disc(at, hand ? 7 : 4.5, tint, colour("--card"), {square: true, width: 1.5});
    name(at, plan().labels[String(pole)], tint, {bold: hand});
  }
}

document.getElementById("before").onclick = () => stepBy(-1);
document.getElementById("after").onclick = () => stepBy(1);
document.getElementById("every").onchange = event => change("step", {every: event.target.checked});

function stepBy(way) {
  const count = plan().steps.length + 1;
  change("step", {step: ((state.step + 1 + way + count) % count) - 1});
}
