// Poles: the pole table, its steps in order, and the two great circles that find a pole.
//
// A pole is given by the names [a, b] of its two links. Its direction is in the ground frame. A step
// of the plan is {text, poles, lines, contacts}: the poles that it gives, pairs of poles that each
// define a great circle, and names of pairs whose contact point defines one with the pole.

const NO_GREAT_CIRCLE = 1e-9;              // sine of the angle between two points that define no great circle

const poleTable = document.getElementById("table");
const currentPlan = () => model.plans[state.moving];
const poleDirection = (row, [a, b]) => readVector(row, `pole_${a}_${b}`, currentPlan().end);

/** Returns the end of a pole axis that faces the eye. */
const facingEnd = point => (dot(point, projection.eye) < 0 ? scale(point, -1) : point);
const isSamePole = ([a, b], [c, d]) => (a === c && b === d) || (a === d && b === c);

/** Writes the pole table of the plan of the moving input. */
function buildTable() {
  const {titles, cells, bodies} = currentPlan();
  const body = document.createElement("tbody");
  const head = document.createElement("tr");
  head.append(document.createElement("td"), ...titles.map(title => makeHeading(title, "col")));
  body.append(head);
  cells.forEach((marks, i) => {
    const tableRow = document.createElement("tr");
    tableRow.append(makeHeading(titles[i], "row"));
    marks.forEach((mark, j) => tableRow.append(makeCell(mark, bodies[i], bodies[j])));
    body.append(tableRow);
  });
  poleTable.tBodies[0]?.remove();
  poleTable.append(body);
  document.getElementById("starred").hidden = !cells.flat().some(mark => mark.includes("*"));
}

/** Returns a heading of the table; its scope is "row" or "col". */
function makeHeading(text, scope) {
  return Object.assign(document.createElement("th"), {textContent: text, scope});
}

/** Returns the cell of the pole of links a and b. If a step gives the pole, a button chooses that step. */
function makeCell(mark, a, b) {
  const cell = document.createElement("td");
  const step = currentPlan().steps.findIndex(({poles}) => poles.some(pole => isSamePole(pole, [a, b])));
  if (a === b || step < 0) {
    cell.textContent = mark;
    return cell;
  }
  const button = document.createElement("button");
  button.type = "button";
  button.textContent = mark;
  button.setAttribute("aria-label", `Pole of ${a} and ${b}: ${mark}`);
  button.dataset.pole = JSON.stringify([a, b]);
  button.onclick = () => change("step", {step: state.step === step ? -1 : step});
  cell.append(button);
  return cell;
}

/** Shows the text of the chosen step, and marks its poles and those it starts from in the table. */
function showStep() {
  const {steps} = currentPlan();
  const step = steps[state.step];
  const resultPoles = step?.poles ?? [];
  const sourcePoles = step?.lines.flat() ?? [];
  for (const button of poleTable.querySelectorAll("button")) {
    const pole = JSON.parse(button.dataset.pole);
    const isResult = resultPoles.some(other => isSamePole(other, pole));
    const isSource = !isResult && sourcePoles.some(other => isSamePole(other, pole));
    button.classList.toggle("hand", isResult);
    button.classList.toggle("source", isSource);
    button.setAttribute("aria-pressed", isResult);
  }
  document.getElementById("step").textContent = step
    ? `${state.step + 1} of ${steps.length}: ${step.text}`
    : `All poles are constructed in ${steps.length} steps. Pick a step, or click a cell of the table.`;
  document.getElementById("every").checked = state.every;
}

/**
 * Adds the great circles of the chosen step to the lines of the sphere.
 * @param row - Results of the picture kernel.
 * @returns [{kind, pole, direction}] - The poles to mark: "result" and "source" poles of the step, and
 *   "other" ones if every pole is shown.
 */
function addPoleCircles(row) {
  const {steps} = currentPlan();
  const step = steps[state.step];
  const markByName = new Map();            // a later mark of a pole replaces an earlier one
  const addMark = (kind, pole) => markByName.set(String(pole), {kind, pole});
  if (state.every)
    for (const {poles} of steps)
      for (const pole of poles) addMark("other", pole);
  if (step) {
    for (const pole of step.lines.flat()) addMark("source", pole);
    for (const pole of step.poles) addMark("result", pole);
    for (const [start, end] of step.lines) addGreatCircle(poleDirection(row, start), poleDirection(row, end));
    for (const pair of step.contacts) addGreatCircle(poleDirection(row, step.poles[0]), contactPoint(row, pair));
  }
  return [...markByName.values()].map(({kind, pole}) => ({kind, pole, direction: facingEnd(poleDirection(row, pole))}));
}

/** Adds the dashed great circle through two points. */
function addGreatCircle(a, b) {
  const normal = cross(a, b);
  if (!(Math.hypot(...normal) > NO_GREAT_CIRCLE)) return;
  addLine(circlePoints(normalize(normal), Math.PI / 2), themeColour("--fold"), 1.4, {dash: [7, 4], faint: 0.45});
}

/** Returns the contact of a pair: the middle of the nearest points of its two drawn profiles. */
function contactPoint(row, pairName) {
  const pair = model.pairs.find(({name}) => name === pairName);
  const [firstCurve, secondCurve] = pair.links.map(link => {
    const profile = model.links[linkNumber.get(link)].profiles.find(other => other.pair === pairName);
    return profile.curve.map(point => rotate(linkOrientation(row, link), point));
  });
  let largestCosine = -1;
  let contact = firstCurve[0];
  for (const a of firstCurve)
    for (const b of secondCurve) {
      const cosine = dot(a, b);
      if (cosine > largestCosine) {
        largestCosine = cosine;
        contact = normalize(add(a, b));
      }
    }
  return contact;
}

/** Returns the colour of a mark of a pole by its kind. */
function poleColour(kind) {
  if (kind === "result") return themeColour("--gold");
  if (kind === "source") return themeColour("--fold");
  return isDark() ? "#a5863a" : "#7a6222";
}

/** Draws the marks of poles that `addPoleCircles` returns, with their names. */
function drawPoles(marks) {
  for (const {kind, pole, direction} of marks) {
    const isResult = kind === "result";
    const tint = poleColour(kind);
    drawDisc(direction, isResult ? 7 : 4.5, tint, themeColour("--card"), {square: true, width: 1.5});
    addLabel(direction, currentPlan().labels[String(pole)], tint, {bold: isResult});
  }
}

/** Chooses the next step (1) or the one before (-1). No step, -1 in the state, comes after the last one. */
function stepBy(direction) {
  const count = currentPlan().steps.length + 1;
  change("step", {step: ((state.step + 1 + direction + count) % count) - 1});
}

document.getElementById("before").onclick = () => stepBy(-1);
document.getElementById("after").onclick = () => stepBy(1);
document.getElementById("every").onchange = event => change("step", {every: event.target.checked});
