// The one state of the page: machines with their components, alarms that stand, the link to the daemon.

import { get } from "./api.js";
import { follow } from "./stream.js";

/** Time between two looks for data that no event tells of: how fresh they are. */
const LOOK_MS = 4000;
const LOOK_MANY_MS = 12_000;
const MANY = 50;
/** Events that come together are answered by one look. */
const GATHER_MS = 120;

export const state = {
  /** `null`: not known yet. */
  machines: null,
  alarms: null,
  /** Simulated machines; none where the daemon has none. */
  simulations: [],
  link: "connecting",
  /** Why the last look failed. */
  error: null,
  /** When the last look succeeded, ms. */
  lookedAt: 0,
};

const watchers = new Set();

/** Calls `watcher(state)` after each change until the answer is called. */
export function watch(watcher) {
  watchers.add(watcher);
  return () => watchers.delete(watcher);
}

function tell() {
  for (const watcher of [...watchers]) watcher(state);
}

let isLooking = false;
let lookAgain = false;
/** Whether any machine is simulated; `null`: not known yet. */
let hasSimulation = null;

async function alarmsThatStand() {
  const all = [];
  // 5000 alarms are beyond what anybody reads; the daemon's pages hold 1000.
  for (let after = null, pages = 0; pages < 5; pages += 1) {
    const page = await get("/alarms", { limit: 1000, after });
    all.push(...page.items);
    after = page.next;
    if (!after) break;
  }
  return all;
}

async function simulations() {
  // What has a lag of its simulation is simulated: asking for scenarios where there are none would be an error.
  hasSimulation ??= (await get("/system")).streams.some((stream) => stream.simulation_lag_s !== null);
  return hasSimulation ? (await get("/simulation/scenario")).items : [];
}

/** Looks at everything anew; a call while one runs makes one more follow. */
export async function look() {
  if (isLooking) {
    lookAgain = true;
    return;
  }
  isLooking = true;
  try {
    const [machines, alarms, simulated] = await Promise.all([
      get("/machines", { components: true }),
      alarmsThatStand(),
      simulations(),
    ]);
    Object.assign(state, { machines: machines.items, alarms, simulations: simulated, error: null, lookedAt: Date.now() });
    if (state.link === "lost") state.link = "connecting";
  } catch (error) {
    state.error = error;
    state.link = "lost";
  } finally {
    isLooking = false;
  }
  tell();
  if (lookAgain) {
    lookAgain = false;
    look();
  }
}

let gathering = null;

function lookSoon() {
  gathering ??= setTimeout(() => {
    gathering = null;
    look();
  }, GATHER_MS);
}

/** Begins to follow the daemon. */
export function start() {
  look();
  follow(lookSoon, (link) => {
    if (link === "live" && state.error) look();
    state.link = link;
    tell();
  });
  const tick = () => {
    if (!document.hidden) look();
    setTimeout(tick, (state.machines?.length ?? 0) > MANY ? LOOK_MANY_MS : LOOK_MS);
  };
  setTimeout(tick, LOOK_MS);
  document.addEventListener("visibilitychange", () => document.hidden || look());
}

const RANK = { damaged: 0, warning: 1, undetermined: 2, healthy: 3 };

/** Smaller is worse. */
export const rank = (name) => RANK[name] ?? 2;

/** Components, the worst first. */
export function worstFirst(components) {
  return [...components].sort((a, b) => rank(a.state) - rank(b.state) || (b.severity ?? 0) - (a.severity ?? 0));
}

export const machineOf = (id) => state.machines?.find((machine) => machine.id === id) ?? null;
export const alarmsOf = (machine, kind, component) =>
  (state.alarms ?? []).filter((a) => a.machine === machine && (!kind || (a.kind === kind && a.component === component)));
