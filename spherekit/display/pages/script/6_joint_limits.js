// Joint limits of the file: ranges that the variables of R pairs cannot leave. The page shows
// where a mode is beyond them, and goes there all the same.
//
// The angle of a passive pair is known up to whole turns: it is within the limits if any number
// of turns brings it there.

const limits = model.limits.map(({pair, low, high}) => {
  const driven = inputs.findIndex(input => input.pair === pair), column = rows.place.get(`theta_${pair}`);
  return {pair, low, high, driven, angle: (row, q) => (driven < 0 ? row[column] : q[driven])};
});

function angleNearLimits({low, high, driven, angle}, row, q) {  // rad, less whole turns of a passive pair
  const middle = 0.5 * (low + high), off = angle(row, q) - middle;
  return middle + (driven < 0 ? Math.atan2(Math.sin(off), Math.cos(off)) : off);
}

function marginOf(limit, row, q) {         // rad to the nearer limit, negative beyond it
  const angle = angleNearLimits(limit, row, q);
  return Math.min(angle - limit.low, limit.high - angle);
}

const leastMargin = (row, q) => limits.reduce((least, limit) => Math.min(least, marginOf(limit, row, q)), Infinity);

function rangesBeyondLimits(mode, q, sizes, {over, x, values}) {  // along a curve: [{from, to}]
  if (!limits.length) return [];
  const at = value => q.with(over, value);
  const margin = value => {
    const row = mode.state(at(value), sizes)?.row;
    return row ? leastMargin(row, at(value)) : NaN;
  };
  const margins = values.map((row, n) => (row ? leastMargin(row, at(x[n])) : NaN));
  const border = n => lastWithin(margin, margins[n] >= 0 ? x[n] : x[n + 1], margins[n] >= 0 ? x[n + 1] : x[n]);
  const ranges = [];
  let from = margins[0] < 0 ? x[0] : null;
  for (let n = 0; n + 1 < x.length; n++) {
    const [here, next] = [margins[n], margins[n + 1]];
    if (from !== null && !(next < 0)) {
      ranges.push({from, to: next >= 0 ? border(n) : x[n]});
      from = null;
    } else if (from === null && next < 0) from = here >= 0 ? border(n) : x[n + 1];
  }
  if (from !== null) ranges.push({from, to: x.at(-1)});
  return ranges;
}

function lastWithin(margin, within, beyond) {
  return bisect(within, beyond, value => margin(value) >= 0);
}

function limitText({pair, low, high}) {
  const angle = x => `${text(x / UNIT, false)}${SIGN === "°" ? SIGN : " rad"}`;
  return `${pair} may go from ${angle(low)} to ${angle(high)}`;
}

function beyondText(row, q) {              // which limits a configuration is beyond
  const passed = limits.filter(limit => marginOf(limit, row, q) < 0);
  return passed.length ? `beyond a joint limit: ${passed.map(limitText).join("; ")}` : "";
}
