// The simulated rig: damage it, and see beside the truth what the diagnosis, which is not told, finds.

import { get, machinePath, post } from "./api.js";
import { badge, choice, empty, failed, field, fill, h, loading, select } from "./dom.js";
import { fault, number, percent, since, span, words } from "./format.js";
import { look, worstFirst } from "./store.js";

const GROW = [["0", "at once"], ["10", "over 10 s"], ["60", "over 1 min"], ["600", "over 10 min"]];
/** Speeds of the simulated shaft, Hz. */
const SPEEDS = [5, 10, 15, 20, 25, 30];
const PARTS = { BG: "gear", BS: "shaft", BB: "bearing" };

const scenarioText = (name) => name.split("_").flatMap((part) => PARTS[part] ?? []).join(", ") || "nothing";

/** Sizes of what can be damaged; the presets' are those of the scenarios. */
const SIZES = {
  depth: { label: "Depth", unit: "µm", min: 5, max: 200, step: 1, value: 101.6 },
  width: { label: "Width", unit: "mm", min: 0.2, max: 3, step: 0.01, value: 1.27 },
  bow: { label: "Bow", unit: "µm", min: 5, max: 400, step: 1, value: 203.2 },
  wear: { label: "Depth", unit: "µm", min: 1, max: 60, step: 0.1, value: 12.7 },
  crack: { label: "Depth", unit: "µm", min: 50, max: 2000, step: 10, value: 800 },
  tooth: { label: "Tooth", unit: "", min: 1, max: 28, step: 1, value: 23 },
};

/** A fault of the truth in words. */
export function faultText(one) {
  if (one.fault === "bow") return `bow of ${number(one.amplitude_um)} µm`;
  if (one.fault === "tooth_damage") {
    const sizes = [[one.depth_um, "µm deep"], [one.slope_um, "µm at the tip"], [one.form_um, "µm in the middle"], [one.offset_um, "µm off its place"]];
    const told = sizes.filter(([size]) => size).map(([size, text]) => `, ${number(size)} ${text}`).join("");
    return `tooth ${one.tooth} of ${one.gear}${one.member === "mate" ? " (mate)" : ""}: ${words(one.kind)}${told}`;
  }
  return `${words(one.fault)} of ${one.bearing}, ${number(one.width_mm)} mm wide, ${number(one.depth_um)} µm deep`;
}

function slider(key, values) {
  const { label, unit, min, max, step, value } = SIZES[key];
  values[key] ??= value;
  const out = h("output", null, `${number(values[key])} ${unit}`);
  const input = h("input", { type: "range", min, max, step, "aria-label": `${label}, ${unit || "number"}`, oninput: () => {
    values[key] = Number(input.value);
    out.textContent = `${number(values[key])} ${unit}`;
  } });
  input.value = String(values[key]);
  return field(label, h("span", { class: "slider" }, input, out));
}

export function openDemo(root, { parts }) {
  let machine = parts[1] ?? null;
  let description = null;
  let grow = "0";
  const values = {};
  const wanted = { bearing: "none", shaft: false, gear: "none" };
  const bar = h("div", { class: "bar" });
  const presets = h("section", { class: "card" }, loading("simulation"));
  const own = h("section", { class: "card" }, loading("machine"));
  const truth = h("section", { class: "card", "aria-label": "Truth" });
  const verdict = h("section", { class: "card", "aria-label": "Diagnosis" });
  const said = h("p", { class: "said", role: "status" });
  root.append(bar, h("div", { class: "two" }, presets, own), said, h("div", { class: "two" }, truth, verdict));
  const made = {};

  function whenChanged(name, data, make) {
    const text = JSON.stringify(data);
    if (made[name] === text) return;
    made[name] = text;
    make();
  }

  async function apply(body, text) {
    said.textContent = `${text} …`;
    try {
      await post("/simulation/scenario", { machine, ...(body.shaft_speed_hz ? {} : { grow_s: Number(grow) }), ...body });
      said.textContent = `${text}. The diagnosis follows within half a minute.`;
    } catch (error) {
      said.textContent = `Not applied: ${error.message}`;
    }
    look();
  }

  function drawPresets(simulation) {
    const buttons = simulation.scenarios.map((name) =>
      h("button", { type: "button", "aria-pressed": String(name === simulation.scenario), dataset: { scenario: name }, onclick: () => apply({ scenario: name }, `${name} applied`) },
        h("strong", null, scenarioText(name)), h("span", { class: "soft" }, name)));
    const focused = presets.contains(document.activeElement) ? document.activeElement.dataset.scenario : null;
    fill(presets, h("h2", null, "Damage"), h("div", { class: "presets" }, buttons), h("div", { class: "field" }, h("span", null, "Growing"), growth()), simulation.shaft_speed_hz !== null && speeds(simulation));
    if (focused) presets.querySelector(`[data-scenario="${focused}"]`)?.focus();
  }

  /** The shaft turns at another speed; the scene begins anew at it. */
  function speeds(simulation) {
    const now = Math.abs(simulation.shaft_speed_hz);
    const options = [...new Set([...SPEEDS, now])].sort((a, b) => a - b).map((hz) => [String(hz), `${number(hz)} Hz`]);
    return h("div", { class: "field" }, h("span", null, "Shaft speed"), choice("Shaft speed", options, String(now), (value) => apply({ shaft_speed_hz: Number(value) }, `The shaft turns at ${value} Hz; a baseline learned at another speed is not used`)));
  }

  function growth() {
    const host = h("div");
    const draw = () => fill(host, choice("Growing", GROW, grow, (value) => {
      grow = value;
      draw();
    }));
    draw();
    return host;
  }

  function drawOwn() {
    if (!description) return;
    const hasBearing = description.bearings.length > 0;
    const bearings = description.bearings.map((one) => [one.id, one.id]);
    values.bearing ??= description.bearings.at(-1)?.id;
    const redraw = () => drawOwn();
    fill(
      own,
      h("h2", null, "Damage of your own size"),
      hasBearing && h("fieldset", null, h("legend", null, "Bearing"),
        choice("Bearing", [["none", "good"], ["inner_race", "inner race"], ["outer_race", "outer race"], ["rolling_element", "ball"]], wanted.bearing, (value) => { wanted.bearing = value; redraw(); }),
        wanted.bearing !== "none" && [field("Which", select(bearings, values.bearing, (value) => (values.bearing = value))), slider("width", values), slider("depth", values)]),
      h("fieldset", null, h("legend", null, "Shaft"),
        choice("Shaft", [["", "good"], ["bow", "bow"]], wanted.shaft ? "bow" : "", (value) => { wanted.shaft = value === "bow"; redraw(); }),
        wanted.shaft && slider("bow", values)),
      description.gears.length > 0 && h("fieldset", null, h("legend", null, "Gear"),
        choice("Gear", [["none", "good"], ["worn", "worn tooth"], ["cracked", "cracked tooth"], ["missing", "missing tooth"]], wanted.gear, (value) => { wanted.gear = value; redraw(); }),
        wanted.gear !== "none" && slider("tooth", values), wanted.gear === "worn" && slider("wear", values), wanted.gear === "cracked" && slider("crack", values)),
      h("button", { type: "button", class: "primary", onclick: () => apply({ faults: faults() }, "Applied") }, "Apply"),
    );
  }

  function faults() {
    const list = [];
    if (wanted.bearing !== "none") list.push({ fault: wanted.bearing, bearing: values.bearing, width_mm: values.width, depth_um: values.depth });
    if (wanted.shaft) list.push({ fault: "bow", amplitude_um: values.bow });
    if (wanted.gear !== "none") {
      const tooth = { fault: "tooth_damage", gear: description.gears[0].id, tooth: values.tooth, kind: wanted.gear };
      list.push(wanted.gear === "missing" ? tooth : { ...tooth, depth_um: wanted.gear === "cracked" ? values.crack : values.wear });
    }
    return list;
  }

  function drawTruth(simulation) {
    const pace = simulation.source === "failed" ? "ended by an error" : simulation.speed === null ? "as fast as it is analysed" : simulation.keeps_pace ? `${number(simulation.speed)} × real time` : "does not keep up with its pace";
    fill(
      truth,
      h("h2", null, "What is damaged"),
      simulation.present.length ? h("ul", null, simulation.present.map((one) => h("li", null, faultText(one)))) : h("p", null, "Nothing."),
      h("p", { class: "soft" }, `Scene ${simulation.scene}; asked for ${since(simulation.since)} ago${simulation.growing ? ", still growing" : ""}; ${span(simulation.simulated_s)} simulated, ${pace}.`),
      simulation.warnings.map((warning) => h("p", { class: "note" }, `Beyond the model: ${warning}.`)),
    );
  }

  function drawVerdict(item) {
    const components = worstFirst(item?.components ?? []);
    fill(
      verdict,
      h("h2", null, "What the diagnosis says"),
      components.length === 0 && empty("No window judged yet."),
      h("ul", { class: "verdicts" }, components.map((one) =>
        h("li", null, badge(one.state), " ", h("a", { href: `#/machine/${encodeURIComponent(machine)}/${one.kind}/${encodeURIComponent(one.id)}` }, `${one.kind} ${one.id}`), one.fault ? `: ${fault(one.fault, one.state)}` : "", h("span", { class: "soft" }, one.severity === null ? "" : ` severity ${one.severity.toFixed(2)}, ${percent(one.confidence)} sure`)))),
      h("p", { class: "soft" }, "It is not told what is damaged, and judges a window of ten seconds every five."),
    );
  }

  async function describe() {
    try {
      description = await get(machinePath(machine));
      drawOwn();
    } catch (error) {
      fill(own, failed(error, describe));
    }
  }

  function update(state) {
    const isNone = state.machines !== null && state.simulations.length === 0;
    // Without a simulation nothing will come for the other cards to show.
    for (const card of [own, truth, verdict]) card.hidden = isNone;
    if (state.simulations.length === 0) {
      if (isNone) fill(presets, empty("No machine is simulated: a source of kind “simulated” in the configuration is, and so is the rig of rotorwatch demo."));
      return;
    }
    const ids = state.simulations.map((one) => one.machine);
    machine ??= ids[0];
    const simulation = state.simulations.find((one) => one.machine === machine) ?? state.simulations[0];
    whenChanged("bar", ids, () => fill(bar, h("h1", null, "Simulation"), ids.length > 1 && select(ids.map((id) => [id, id]), machine, (id) => (location.hash = `#/simulation/${encodeURIComponent(id)}`), { "aria-label": "Machine" })));
    whenChanged("presets", [simulation.scenarios, simulation.scenario, simulation.shaft_speed_hz], () => drawPresets(simulation));
    whenChanged("truth", simulation, () => drawTruth(simulation));
    const item = state.machines?.find((one) => one.id === machine);
    whenChanged("verdict", item?.components, () => drawVerdict(item));
    whenChanged("machine", machine, describe);
  }

  return { update };
}
