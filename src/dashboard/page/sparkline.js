// Severity of a component over the last hours, small; asked for only when it is looked at.

import { get, machinePath } from "./api.js";
import { s } from "./dom.js";
import { span } from "./format.js";

const SIZE = { width: 120, height: 26 };
const KEEP_MS = 60_000;
/** Asked for at a time, so that what an operator clicks on does not wait behind hundreds of them. */
const AT_ONCE = 1;
const MOST_KEPT = 4000;

const kept = new Map();
const waiting = [];
let running = 0;

function next() {
  while (running < AT_ONCE && waiting.length > 0) {
    const work = waiting.shift();
    running += 1;
    work().finally(() => {
      running -= 1;
      next();
    });
  }
}

async function severity(machine, kind, component) {
  const key = `${machine}\n${kind}\n${component}`;
  const found = kept.get(key);
  if (found && Date.now() - found.at < KEEP_MS) return found.column;
  const path = `${machinePath(machine)}/components/${kind}/${encodeURIComponent(component)}/trend`;
  const answer = await get(path, { features: "severity", max_points: 80 });
  const column = answer.features[0] ?? { time_s: [], value: [] };
  if (kept.size >= MOST_KEPT) kept.delete(kept.keys().next().value);
  kept.set(key, { at: Date.now(), column });
  return column;
}

const watched = new WeakMap();
const seen = new IntersectionObserver((entries) => {
  for (const entry of entries) {
    const work = entry.isIntersecting && watched.get(entry.target);
    if (!work) continue;
    watched.delete(entry.target);
    seen.unobserve(entry.target);
    waiting.push(work);
  }
  next();
});

/** The line, empty until it is on the screen and its data are there. */
export function sparkline(machine, { kind, id, state }) {
  const picture = s("svg", {
    class: `spark ${state}`,
    viewBox: `0 0 ${SIZE.width} ${SIZE.height}`,
    role: "img",
    "aria-label": `severity of ${id}: not known yet`,
  });
  watched.set(picture, async () => {
    if (!picture.isConnected) return;
    try {
      draw(picture, await severity(machine, kind, id), id);
    } catch {
      picture.setAttribute("aria-label", `severity of ${id}: cannot be read`);
    }
  });
  seen.observe(picture);
  return picture;
}

/** Runs of points that follow each other; where nothing was judged there is none. */
function runsOf(points) {
  const runs = [[]];
  for (const point of points) {
    if (point[1] !== null) runs.at(-1).push(point);
    else if (runs.at(-1).length > 0) runs.push([]);
  }
  return runs.filter((run) => run.length > 0);
}

export function draw(picture, column, id) {
  const all = column.time_s.map((t, i) => [t, column.value[i] ?? null]);
  const runs = runsOf(all);
  const points = runs.flat();
  if (points.length < 2) {
    picture.setAttribute("aria-label", `severity of ${id}: too short a history`);
    return;
  }
  // The line ends where the history does: what is not judged now has no value now.
  const [from, to] = [points[0][0], all.at(-1)[0]];
  const x = (t) => 2 + ((t - from) / (to - from || 1)) * (SIZE.width - 6);
  const y = (v) => SIZE.height - 3 - Math.min(1, v) * (SIZE.height - 6);
  const at = ([t, v]) => `${x(t).toFixed(1)} ${y(v).toFixed(1)}`;
  // A point alone is a line of no length, which its round ends make a dot.
  const path = runs.map((run) => `M${at(run[0])}${run.length > 1 ? "" : `L${at(run[0])}`}${run.slice(1).map((one) => `L${at(one)}`).join("")}`).join("");
  const level = (v) => s("line", { x1: 2, x2: SIZE.width - 2, y1: y(v), y2: y(v) });
  const last = points.at(-1);
  const isNow = all.at(-1)[1] !== null;
  const end = isNow ? last[1].toFixed(2) : `${last[1].toFixed(2)}, not judged since`;
  picture.setAttribute("aria-label", `severity of ${id} over ${span(to - from)}: ${points[0][1].toFixed(2)} to ${end}`);
  const now = isNow ? [s("circle", { cx: x(last[0]), cy: y(last[1]), r: 2.5 })] : [];
  picture.replaceChildren(level(0.25), level(0.5), s("path", { d: path }), ...now);
}
