// The status page: polls /api/v1 and shows it. All text goes in by textContent.

const POLL_MS = 2000;
const SVG = "http://www.w3.org/2000/svg";
const PLOT = { width: 800, height: 320, left: 70, right: 10, top: 10, bottom: 40 };

const byId = (id) => document.getElementById(id);

/** The machine shown; null until one is known. */
let shown = null;
/** What each part of the page was last made from, so that typing and focus survive a poll. */
const lastMade = new Map();

async function read(path) {
  const response = await fetch(path, { headers: { accept: "application/json" } });
  const body = await response.json();
  if (!response.ok) throw new Error(body.detail ?? response.statusText);
  return body;
}

function element(tag, text, className) {
  const made = document.createElement(tag);
  if (text !== undefined) made.textContent = text;
  if (className) made.className = className;
  return made;
}

/** Runs `make` only if `data` differ from those of the last time. */
function whenChanged(name, data, make) {
  const text = JSON.stringify(data);
  if (lastMade.get(name) === text) return;
  lastMade.set(name, text);
  make();
}

const percent = (value) => (value === null ? "" : `${Math.round(value * 100)} %`);
const fixed = (value) => (value === null ? "" : value.toFixed(2));
const words = (name) => (name ?? "").replaceAll("_", " ");
const state = (name) => element("span", name, `state ${name}`);

function showMachines(machines) {
  whenChanged("machines", [machines, shown], () => {
    const buttons = machines.map((machine) => {
      const button = element("button");
      button.type = "button";
      button.setAttribute("aria-pressed", String(machine.id === shown));
      button.append(`${machine.name || machine.id}: `, state(machine.state));
      if (machine.source !== "running") button.append(` (source ${machine.source})`);
      button.addEventListener("click", () => {
        shown = machine.id;
        poll();
      });
      return button;
    });
    const focused = [...byId("machines").children].indexOf(document.activeElement);
    byId("machines").replaceChildren(...buttons);
    buttons[focused]?.focus();
  });
}

function showHealth(health) {
  whenChanged("health", health, () => {
    const { judged, undetermined } = health.data.coverage;
    byId("health-note").textContent =
      `${health.machine}: ${health.state}` +
      (health.since ? ` since ${health.since}` : ", no window judged yet") +
      `; ${words(health.operating_state)}; ${judged} judged, ${undetermined.length} undetermined` +
      `; newest sample ${health.data.last_sample_time ?? "none"}` +
      (health.data.time_unknown ? " (start of the stream unknown)" : "") +
      (health.data.reason ? `; source failed: ${health.data.reason}` : "");
    const rows = health.components.map((component) => {
      const row = element("tr");
      const name = element("th", `${component.id} (${component.kind})`);
      name.scope = "row";
      const cell = element("td");
      cell.append(state(component.state));
      row.append(
        name,
        cell,
        element("td", words(component.fault)),
        element("td", fixed(component.severity)),
        element("td", percent(component.confidence)),
        element("td", component.why),
      );
      return row;
    });
    byId("components").replaceChildren(...rows);
  });
}

/** `GG_BS_BB` in words. */
function scenarioText(name) {
  const parts = { BG: "gear", BS: "shaft", BB: "bearing" };
  const bad = name.split("_").flatMap((part) => parts[part] ?? []);
  return `${name}: ${bad.length ? `${bad.join(", ")} bad` : "nothing bad"}`;
}

/** A fault of a tooth: kind, tooth, and the sizes that are not nothing. */
function toothText(fault) {
  const sizes = [
    [fault.depth_um, "µm deep"],
    [fault.slope_um, "µm at the tip"],
    [fault.form_um, "µm in the middle"],
    [fault.offset_um, "µm off its place"],
  ];
  const told = sizes.filter(([size]) => size).map(([size, text]) => `, ${short(size)} ${text}`);
  const factor = fault.stiffness_factor ?? 1;
  if (factor !== 1) told.push(`, ${short(factor)} times as stiff`);
  const mate = fault.member === "mate" ? " (mate)" : "";
  return `tooth ${fault.tooth} of ${fault.gear}${mate}: ${words(fault.kind)}${told.join("")}`;
}

function faultText(fault) {
  if (fault.fault === "bow") return `bow of ${short(fault.amplitude_um)} µm`;
  if (fault.fault === "tooth_damage") return toothText(fault);
  const size = `${short(fault.width_mm)} mm wide, ${short(fault.depth_um)} µm deep`;
  return `${words(fault.fault)} of ${fault.bearing}, ${size}`;
}

/** The control of a simulated machine; hidden for every other. */
function showSimulation(simulation) {
  byId("simulation").hidden = !simulation;
  if (!simulation) return;
  whenChanged("scenarios", [shown, simulation.scenarios, simulation.scenario], () => {
    const options = simulation.scenarios.map((name) => new Option(scenarioText(name), name));
    byId("scenario").replaceChildren(...options);
    byId("scenario").value = simulation.scenario ?? "";
  });
  const pace =
    simulation.source === "failed"
      ? "ended by an error"
      : simulation.speed === null
        ? "as fast as it is analysed"
        : simulation.keeps_pace
          ? `keeps ${short(simulation.speed)} × real time`
          : "does not keep up with its pace";
  const behind = simulation.lag_given_up_s > 0 ? `, ${short(simulation.lag_given_up_s)} s behind` : "";
  const present = simulation.present.map(faultText).join("; ") || "nothing";
  byId("simulation-note").textContent =
    `scene ${simulation.scene}, ${Math.floor(simulation.simulated_s)} s simulated, ${pace}${behind}. ` +
    `Scenario ${simulation.scenario ?? "of its own"} since ${simulation.since}` +
    `${simulation.growing ? ", still growing" : ""}. Damaged now: ${present}. ` +
    "The diagnosis below is not told." +
    simulation.warnings.map((warning) => ` Beyond the model: ${warning}.`).join("");
}

async function applyScenario(event) {
  event.preventDefault();
  const result = byId("simulation-result");
  const wanted = { machine: shown, scenario: byId("scenario").value, grow_s: Number(byId("grow-s").value) };
  try {
    const response = await fetch("/api/v1/simulation/scenario", {
      method: "POST",
      headers: { "content-type": "application/json" },
      body: JSON.stringify(wanted),
    });
    const body = await response.json();
    result.textContent = response.ok ? `${wanted.scenario} applied.` : `Not applied: ${body.detail}`;
  } catch (error) {
    result.textContent = `Not applied: ${error.message}`;
  }
  poll();
}

/** The simulated machines; asked for until the daemon has said that it has none. */
let anySimulated = true;

async function readSimulations() {
  if (!anySimulated) return [];
  const response = await fetch("/api/v1/simulation/scenario", { headers: { accept: "application/json" } });
  if (response.status === 404) anySimulated = false;
  return response.ok ? (await response.json()).items : [];
}

function acknowledgeForm(alarm) {
  const form = element("form");
  const field = (name, label, required) => {
    const wrapper = element("label", `${label} `);
    const input = element("input");
    Object.assign(input, { name, required, maxLength: 2000, autocomplete: "off" });
    wrapper.append(input);
    return wrapper;
  };
  const button = element("button", "Acknowledge");
  button.type = "submit";
  button.setAttribute("aria-label", `Acknowledge alarm ${alarm.id}`);
  form.append(field("author", "Name", true), field("comment", "Comment", false), button);
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    const entered = Object.fromEntries(new FormData(form));
    const result = byId("ack-result");
    try {
      const response = await fetch(`/api/v1/alarms/${encodeURIComponent(alarm.id)}/ack`, {
        method: "POST",
        headers: { "content-type": "application/json" },
        body: JSON.stringify(entered),
      });
      const body = await response.json();
      result.textContent = response.ok ? `${alarm.id} acknowledged.` : body.detail;
    } catch (error) {
      result.textContent = `Not acknowledged: ${error.message}`;
    }
    poll();
  });
  return form;
}

function showAlarms(alarms) {
  // A form that somebody fills is left alone until it is sent or left.
  if (byId("alarms").contains(document.activeElement) && document.activeElement.value) return;
  whenChanged("alarms", alarms, () => {
    const items = alarms.map((alarm) => {
      const item = element("li");
      const title = element("p");
      title.append(
        state(alarm.level),
        ` ${alarm.machine} ${alarm.component} ${words(alarm.fault)}: ${words(alarm.state)}, ` +
          `raised ${alarm.raised_at}`,
      );
      item.append(title, element("p", alarm.why));
      if (alarm.acknowledgement) {
        const { author, comment } = alarm.acknowledgement;
        item.append(element("p", `Acknowledged by ${author}${comment ? `: ${comment}` : ""}`));
      }
      if (alarm.silenced) {
        const { author, comment, until } = alarm.silenced;
        const end = until ? ` until ${until}` : "";
        item.append(element("p", `${words(alarm.state)} by ${author}${end}${comment ? `: ${comment}` : ""}`));
      }
      const asks = ["unacknowledged", "returned_unacknowledged"].includes(alarm.state);
      if (asks) item.append(acknowledgeForm(alarm));
      return item;
    });
    byId("alarms").replaceChildren(...(items.length ? items : [element("li", "No alarm stands.")]));
  });
}

function showChannels(channels) {
  const names = channels.map((channel) => channel.name);
  whenChanged("channels", [shown, names], () => {
    const chosen = byId("channel").value;
    byId("channel").replaceChildren(...names.map((name) => new Option(name, name)));
    if (names.includes(chosen)) byId("channel").value = chosen;
  });
}

function svg(tag, attributes, text) {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  if (text !== undefined) made.textContent = text;
  return made;
}

/** Round steps of 1, 2 or 5 that divide `span` into about `count` parts. */
function step(span, count) {
  const raw = span / count;
  const power = 10 ** Math.floor(Math.log10(raw));
  return power * ([1, 2, 5].find((factor) => factor * power >= raw) ?? 10);
}

const short = (value) => Number(value.toPrecision(3)).toString();

function draw(spectrum) {
  const { width, height, left, right, top, bottom } = PLOT;
  const logarithmic = byId("logarithmic").checked;
  const frequencies = spectrum.frequency_hz;
  const highest = Math.max(...spectrum.value, Number.MIN_VALUE);
  // Five decades below the highest line are shown.
  const scale = (v) => (logarithmic ? Math.log10(Math.max(v, highest * 1e-5)) : v);
  const [low, high] = logarithmic ? [scale(0), scale(highest)] : [0, highest];
  const [from, to] = [frequencies[0] ?? 0, frequencies.at(-1) ?? 1];
  const x = (f) => left + ((f - from) / (to - from || 1)) * (width - left - right);
  const y = (v) => height - bottom - ((v - low) / (high - low || 1)) * (height - top - bottom);
  const parts = [];
  const stepX = step(to - from || 1, 6);
  for (let f = Math.ceil(from / stepX) * stepX; f <= to; f += stepX) {
    parts.push(svg("line", { class: "axis", x1: x(f), x2: x(f), y1: top, y2: height - bottom }));
    parts.push(svg("text", { x: x(f), y: height - 20, "text-anchor": "middle" }, short(f)));
  }
  const stepY = logarithmic ? 1 : step(high - low || 1, 4);
  for (let v = Math.ceil(low / stepY) * stepY; v <= high + 1e-12; v += stepY) {
    parts.push(svg("line", { class: "axis", x1: left, x2: width - right, y1: y(v), y2: y(v) }));
    const label = short(logarithmic ? 10 ** v : v);
    parts.push(svg("text", { x: left - 6, y: y(v) + 4, "text-anchor": "end" }, label));
  }
  parts.push(svg("text", { x: width - right, y: height - 4, "text-anchor": "end" }, "Hz"));
  const points = frequencies.map((f, i) => `${x(f).toFixed(2)},${y(scale(spectrum.value[i])).toFixed(2)}`);
  parts.push(svg("polyline", { class: "curve", points: points.join(" ") }));
  byId("plot").replaceChildren(...parts);
  const peak = spectrum.value.indexOf(Math.max(...spectrum.value));
  byId("plot-note").textContent =
    `${spectrum.channel}, ${spectrum.kind}${spectrum.detector ? ` ${spectrum.detector}` : ""} in ${spectrum.unit}, ` +
    `${spectrum.window} window, resolution ${short(spectrum.resolution_hz)} Hz, ` +
    `${spectrum.averages} average(s), samples ${spectrum.start_sample} to ` +
    `${spectrum.start_sample + spectrum.n_samples}, data ${spectrum.validity}` +
    (peak < 0 ? "" : `; highest line ${short(spectrum.value[peak])} at ${frequencies[peak].toFixed(2)} Hz`);
}

async function showSpectrum() {
  const channel = byId("channel").value;
  if (!shown || !channel) return;
  const query = new URLSearchParams({ kind: byId("kind").value, max_points: "1600" });
  if (byId("window-s").value) query.set("window_s", byId("window-s").value);
  if (byId("max-hz").value) query.set("max_hz", byId("max-hz").value);
  const path = `/api/v1/machines/${encodeURIComponent(shown)}/channels/${encodeURIComponent(channel)}`;
  try {
    draw(await read(`${path}/spectrum?${query}`));
  } catch (error) {
    byId("plot").replaceChildren();
    byId("plot-note").textContent = `No spectrum: ${error.message}`;
  }
}

let polling = false;

async function poll() {
  if (polling || document.hidden) return;
  polling = true;
  try {
    const machines = (await read("/api/v1/machines")).items;
    if (!machines.some((machine) => machine.id === shown)) shown = machines[0]?.id ?? null;
    showMachines(machines);
    const [alarms, simulations, health, channels] = await Promise.all([
      read("/api/v1/alarms?limit=50"),
      readSimulations(),
      shown && read(`/api/v1/machines/${encodeURIComponent(shown)}/health`),
      shown && read(`/api/v1/machines/${encodeURIComponent(shown)}/channels`),
    ]);
    showAlarms(alarms.items);
    showSimulation(simulations.find((simulation) => simulation.machine === shown));
    if (shown) {
      showHealth(health);
      showChannels(channels.items);
      await showSpectrum();
    }
    byId("connection").textContent = "connected";
  } catch (error) {
    byId("connection").textContent = `not connected: ${error.message}`;
  } finally {
    polling = false;
  }
}

byId("simulation-form").addEventListener("submit", applyScenario);
byId("spectrum-form").addEventListener("submit", (event) => event.preventDefault());
byId("spectrum-form").addEventListener("change", showSpectrum);
document.addEventListener("visibilitychange", poll);
setInterval(poll, POLL_MS);
poll();
