// Signals: any channel in any representation, with the lines of a component marked; the address holds every choice.

import { get, machinePath } from "./api.js";
import { choice, empty, failed, field, fill, h, loading, select } from "./dom.js";
import { number } from "./format.js";
import { linePlot } from "./plot.js";
import { matchTable } from "./proof.js";
import { DISTRIBUTIONS, WAVELETS, joint, orbit, scalogram, waterfall } from "./pictures.js";
import { KINDS, askLines, askTrend, isSpectrum, specOf, trendSpec } from "./spectra.js";
import { alarmsOf } from "./store.js";
import { usualOf } from "./usual.js";

const LIVE_MS = 2000;
const NUMBERS = ["window_s", "averages", "to", "from", "low", "high", "harmonics", "bands", "peaks", "turns", "hours", "end"];
const SWITCHES = ["log", "logX", "live"];

function choicesOf(query) {
  const found = { kind: "amplitude", channel: null, lines: null, feature: null, detector: null };
  for (const [name, value] of query) {
    if (NUMBERS.includes(name)) found[name] = Number.isFinite(Number(value)) ? Number(value) : null;
    else if (SWITCHES.includes(name)) found[name] = value === "1";
    else found[name] = value;
  }
  if (!KINDS[found.kind]) found.kind = "amplitude";
  return found;
}

export function openSignals(root, { parts, query, state }) {
  const id = parts[1] ?? state.machines?.[0]?.id ?? null;
  const choices = choicesOf(query);
  const bar = h("div", { class: "bar" });
  const controls = h("form", { class: "card controls", onsubmit: (event) => event.preventDefault() });
  const stage = h("section", { class: "card stage", "aria-label": "Plot" }, loading("signals"));
  const numbers = h("section", { class: "numbers" });
  root.append(bar, controls, stage, numbers);

  let machine = null;
  let channels = [];
  /** What the baseline in use holds. */
  let usual = [];
  let shown = null;
  let reference = null;
  let last = null;
  let abort = new AbortController();
  let isClosed = false;
  let isAsking = false;
  let timer = null;

  const channel = () => channels.find((one) => one.name === choices.channel);
  const rate = () => channel()?.sample_rate_hz ?? 1;

  /** Keeps the choices in the address, without opening the view anew. */
  function keep() {
    const kept = new URLSearchParams();
    for (const [name, value] of Object.entries(choices)) {
      if (value === null || value === undefined || value === "" || value === false) continue;
      kept.set(name, value === true ? "1" : value);
    }
    history.replaceState(null, "", `#/signals/${encodeURIComponent(id)}?${kept}`);
  }

  function set(changes) {
    const isOther = "kind" in changes && changes.kind !== choices.kind;
    Object.assign(choices, changes);
    if (isOther) {
      const { window, to, log } = KINDS[choices.kind];
      Object.assign(choices, { window_s: window ?? null, to: to ?? null, from: null, log: log ?? false, averages: null });
    }
    keep();
    if (isOther || "lines" in changes || "channel" in changes) drawControls();
    render();
  }

  const numeric = (name, label, { min = 0, max = 1e6, step = "any", hint = "" } = {}) =>
    field(label, h("input", { type: "number", min, max, step, name, value: choices[name] === null || choices[name] === undefined ? "" : String(choices[name]), placeholder: hint, onchange: (event) => event.target.checkValidity() && set({ [name]: event.target.value === "" ? null : Number(event.target.value) }) }));
  const flag = (name, label) =>
    h("label", { class: "check" }, h("input", { type: "checkbox", name, checked: choices[name] === true, onchange: (event) => set({ [name]: event.target.checked }) }), label);

  function options() {
    const { options: has } = KINDS[choices.kind];
    const spectrum = isSpectrum(choices.kind);
    const components = [
      ...machine.shafts.map((one) => [`shaft/${one.id}`, `shaft ${one.id}`]),
      ...machine.bearings.flatMap((one) => [
        [`bearing/${one.id}`, `bearing ${one.id}`],
        ...["BPFO", "BPFI", "2·BSF", "FTF"].map((label) => [`bearing/${one.id}#${label}`, `bearing ${one.id}: ${label}`]),
      ]),
      ...machine.gears.map((one) => [`gear/${one.id}`, `gear ${one.id}`]),
    ];
    return [
      has.includes("window") && numeric("window_s", "Window, s", { min: 0.001, max: 120 }),
      has.includes("averages") && numeric("averages", "Averages", { min: 1, max: 64, step: 1, hint: choices.kind === "psd" ? "8" : "1" }),
      has.includes("from") && numeric("from", "From, Hz", { hint: "usual" }),
      has.includes("to") && numeric("to", "Up to, Hz", { min: 1, hint: "all" }),
      has.includes("band") && [numeric("low", "Band from, Hz", { hint: "usual" }), numeric("high", "Band to, Hz", { hint: "usual" })],
      has.includes("detector") && field("Detector", select([["0-p", "0-p"], ["rms", "RMS"], ["p-p", "p-p"]], choices.detector ?? "0-p", (value) => set({ detector: value }))),
      has.includes("turns") && numeric("turns", "Revolutions", { min: 1, max: 16, step: 1, hint: choices.kind === "orbit" ? "4" : "1" }),
      has.includes("wavelet") && field("Wavelet", select(WAVELETS, choices.wavelet ?? "morlet", (value) => set({ wavelet: value }))),
      has.includes("distribution") && field("Distribution", select(DISTRIBUTIONS, choices.distribution ?? DISTRIBUTIONS[0][0], (value) => set({ distribution: value }))),
      has.includes("feature") && featureSelect(),
      has.includes("hours") && field("Span", select([["0", "in memory"], ["1", "1 hour"], ["24", "1 day"], ["168", "1 week"], ["720", "1 month"]], String(choices.hours ?? 0), (value) => set({ hours: Number(value) }))),
      spectrum && field("Lines of", select([["", "none"], ...components], choices.lines ?? "", (value) => set({ lines: value || null }))),
      spectrum && choices.lines && numeric("harmonics", "Harmonics", { min: 1, max: 20, step: 1, hint: "3" }),
      spectrum && choices.lines && numeric("bands", "Side bands", { min: 0, max: 10, step: 1, hint: "1" }),
      spectrum && choices.kind !== "cepstrum" && numeric("peaks", "Highest peaks", { min: 0, max: 20, step: 1, hint: "0" }),
      has.includes("log") && flag("log", "log y"),
      spectrum && has.includes("log") && flag("logX", "log x"),
    ];
  }

  function featureSelect() {
    const names = last?.trend?.features.map((one) => one.name) ?? [choices.feature ?? "rms"];
    return field("Feature", select(names.map((name) => [name, name.replaceAll("_", " ")]), choices.feature ?? "rms", (value) => set({ feature: value })));
  }

  function drawControls() {
    const focused = controls.contains(document.activeElement) ? { name: document.activeElement.name, value: document.activeElement.dataset.value } : null;
    const list = channels.map((one) => [one.name, `${one.name}${one.sensor ? ` (${one.sensor})` : ""}`]);
    fill(
      controls,
      choice("Representation", Object.entries(KINDS).map(([kind, { name }]) => [kind, name]), choices.kind, (kind) => set({ kind })),
      h("div", { class: "options" },
        field("Channel", select(list, choices.channel, (name) => set({ channel: name }), { name: "channel" })),
        options(),
        flag("live", "live"),
        isSpectrum(choices.kind) && [
          h("button", { type: "button", name: "keep", onclick: () => { reference = last?.answer ?? null; render(); } }, "Keep as reference"),
          reference && h("button", { type: "button", name: "drop", onclick: () => { reference = null; drawControls(); render(); } }, "Drop reference"),
        ]),
    );
    if (focused) (controls.querySelector(focused.value ? `[data-value="${focused.value}"]` : `[name="${focused.name}"]`) ?? controls.querySelector("button"))?.focus();
  }

  function drawBar(now) {
    const ids = (now.machines ?? []).map((one) => [one.id, one.name || one.id]);
    const key = JSON.stringify(ids);
    if (bar.dataset.key === key) return;
    bar.dataset.key = key;
    fill(bar, h("h1", null, "Signals"), ids.length > 0 && select(ids, id, (value) => (location.hash = `#/signals/${encodeURIComponent(value)}`), { "aria-label": "Machine" }), id && h("a", { href: `#/machine/${encodeURIComponent(id)}` }, "Machine and verdicts"));
  }

  function end() {
    shown?.made?.end();
    shown = null;
  }

  /** A plot of the kind chosen: changed where it stands, made where there is none. */
  function line(spec) {
    if (shown?.what === choices.kind && shown.made.update) shown.made.update(spec);
    else {
      end();
      stage.replaceChildren();
      shown = { what: choices.kind, made: linePlot(stage, spec) };
    }
    stage.dataset.kind = choices.kind;
  }

  async function drawLines(signal) {
    const answer = await askLines(machine, choices, rate(), signal);
    if (signal.aborted) return;
    const isFirst = !last?.answer;
    last = { answer };
    const { spec, found, peaks: tops } = specOf(machine, choices, answer, reference, usual);
    line(spec);
    fill(numbers, matchTable(found, answer.unit), tops?.length ? h("p", { class: "card" }, "Highest peaks: ", tops.map((one) => `${number(one.hz, 5)} Hz`).join(", ")) : null);
    if (isFirst) drawControls();
  }

  async function drawTrend(signal) {
    const answer = await askTrend(machine, choices, signal);
    if (signal.aborted) return;
    const isFirst = !last?.trend;
    last = { trend: answer };
    const alarms = alarmsOf(id).filter((one) => one.kind !== "store");
    const spec = trendSpec(choices, answer, alarms, usual);
    if (!spec || spec.series[0].x.length === 0) {
      end();
      fill(stage, empty("No window of this channel has been measured yet."));
    } else line(spec);
    numbers.replaceChildren();
    if (isFirst) drawControls();
  }

  async function drawPicture(signal) {
    const inside = h("div", { class: "inside" });
    if (choices.kind === "waterfall") {
      end();
      fill(stage, inside);
      const made = waterfall(inside, machine, choices, channel, signal);
      shown = { what: "waterfall", made, key: `${choices.channel} ${choices.to}` };
      await made.ready;
    } else {
      const draw = { orbit, joint, scalogram }[choices.kind];
      const made = await draw(inside, machine, choices, signal, rate());
      if (signal.aborted) return made.end();
      end();
      fill(stage, inside);
      shown = { what: choices.kind, made };
    }
    stage.dataset.kind = choices.kind;
    numbers.replaceChildren();
    return undefined;
  }

  async function render({ isLive = false } = {}) {
    if (isClosed || !machine) return;
    if (isLive && isAsking) return;
    clearTimeout(timer);
    if (!isLive) {
      abort.abort();
      abort = new AbortController();
    }
    const { signal } = abort;
    isAsking = true;
    try {
      if (isLive && shown?.what === "waterfall") await shown.made.add();
      else if (choices.kind === "trend") await drawTrend(signal);
      else if (isSpectrum(choices.kind) || choices.kind === "waveform") await drawLines(signal);
      else await drawPicture(signal);
    } catch (error) {
      if (!signal.aborted && !isClosed) {
        if (!isLive) {
          end();
          fill(stage, failed(error, () => render()));
          numbers.replaceChildren();
        }
      }
    } finally {
      isAsking = false;
      if (choices.live && !isClosed) {
        clearTimeout(timer);
        timer = setTimeout(tick, LIVE_MS);
      }
    }
  }

  async function tick() {
    if (isClosed || !choices.live) return;
    if (document.hidden) timer = setTimeout(tick, LIVE_MS);
    else await render({ isLive: true });
  }

  async function begin() {
    if (!id) return;
    try {
      const [description, list, known] = await Promise.all([get(machinePath(id)), get(`${machinePath(id)}/channels`), usualOf(id)]);
      if (isClosed) return;
      machine = description;
      channels = list.items;
      usual = known;
      if (channels.length === 0) {
        fill(stage, empty("No channel yet: the source of this machine has not been opened."));
        return;
      }
      if (!channel()) choices.channel = channels[0].name;
      if (choices.window_s === undefined) {
        const { window, to, log } = KINDS[choices.kind];
        Object.assign(choices, { window_s: window ?? null, to: choices.to ?? to ?? null, log: choices.log ?? log ?? false });
      }
      drawControls();
      render();
    } catch (error) {
      if (!isClosed) fill(stage, failed(error, begin));
    }
  }

  begin();
  return {
    update(now) {
      drawBar(now);
      if (!id && now.machines) {
        if (now.machines[0]) location.replace(`#/signals/${encodeURIComponent(now.machines[0].id)}`);
        else fill(stage, empty("No machine is configured."));
      }
    },
    close() {
      isClosed = true;
      clearTimeout(timer);
      abort.abort();
      end();
    },
  };
}
