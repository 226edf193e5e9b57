// The plots that prove a verdict: of the very windows judged, with the lines it rests on marked.

import { channelPath, get, machinePath } from "./api.js";
import { failed, h, loading } from "./dom.js";
import { hertz, number, quantity, shownIn, timeAxis } from "./format.js";
import { heatMap } from "./heatmap.js";
import { lineOfFault, lineOfIndicator, linesOf, match, speedOf } from "./lines.js";
import { orbitPlot } from "./orbit.js";
import { linePlot } from "./plot.js";

const MOST = 3;

/** How far a piece of evidence stands over what it is held against; below 1: it accuses nobody. */
const excess = (one) => (one.threshold > 0 && one.value !== null ? one.value / one.threshold : 0);

/** What shall be drawn of a component, the most telling first, each `{kind, ...}` once. */
export function plan(machine, component) {
  const wanted = lineOfFault(component.fault);
  // The fault's own line before others, where it is clearest (the envelope) before where it is highest.
  const isProbe = (channel) => machine.sensors.some((sensor) => sensor.channel === channel && sensor.kind === "proximitor");
  // A shaft is judged by what sees it, before what feels it through the housing.
  const seen = (one) => (component.kind === "shaft" && isProbe(one.channel.split("+")[0]) ? 1 : 0);
  const own = (one) => (wanted && lineOfIndicator(one.indicator) === wanted ? (one.indicator.startsWith("envelope") ? 2 : 1) : 0);
  const sorted = [...component.evidence].sort((a, b) => own(b) - own(a) || seen(b) - seen(a) || excess(b) - excess(a));
  const plots = [];
  const add = (key, plot) => plots.length < MOST && !plots.some((one) => one.key === key) && plots.push({ key, ...plot });
  for (const one of sorted) {
    const [first, second] = one.channel.split("+");
    const line = lineOfIndicator(one.indicator);
    const only = wanted ?? line;
    if (line && one.indicator.startsWith("envelope")) add("envelope", { kind: "envelope", evidence: one, channel: first, only });
    else if (line) add(second ? "absolute" : `amplitude ${first}`, { kind: second ? "absolute" : "amplitude", evidence: one, channel: first, with: second, only });
    else if (/^(tsa|cwt|absolute_cwt)_/.test(one.indicator) && component.kind === "gear") {
      add("scalogram", { kind: "scalogram", evidence: one, channel: first });
      add("amplitude", { kind: "amplitude", evidence: one, channel: first });
    } else if (/^(line|forward|backward|absolute_cwt|cwt)_/.test(one.indicator)) {
      add(`amplitude ${first}`, { kind: "amplitude", evidence: one, channel: first });
      if (isProbe(first)) add("orbit", { kind: "orbit", evidence: one, channel: first });
    } else {
      add(`trend ${first}`, { kind: "trend", evidence: one, channel: first });
    }
  }
  return plots;
}

/** Parameters of the samples judged. */
function judged(evidence, rateHz) {
  const [from, to] = evidence.sample_range ?? [null, null];
  const parameters = { end: to };
  if (from !== null && rateHz) parameters.window_s = Math.min(120, (to - from) / rateHz);
  return parameters;
}

/** Asks for the samples judged; for the newest where those are no longer held. */
async function ofWindow(path, evidence, rateHz, parameters, signal) {
  try {
    return { answer: await get(path, { ...parameters, ...judged(evidence, rateHz) }, signal), isNewer: false };
  } catch (error) {
    if (error.status !== 404) throw error;
    return { answer: await get(path, parameters, signal), isNewer: true };
  }
}

const NAMES = {
  envelope: "Envelope spectrum",
  absolute: "Absolute vibration spectrum",
  amplitude: "Amplitude spectrum",
};

/** Axis of values of a spectrum, with unit and detector. */
export function valueLabel(spectrum) {
  if (spectrum.kind === "envelope") return "modulation depth (1)";
  if (spectrum.kind === "cepstrum") return "cepstrum (1)";
  const { unit } = shownIn(spectrum.unit);
  return spectrum.kind === "psd" ? `density (${unit})` : `amplitude (${unit}, ${spectrum.detector})`;
}

/** Cursors of a plot from matched lines. */
export function cursorsOf(found, factor) {
  return found
    .filter((one) => one.kind === "line" || one.matched)
    .map((one) => ({
      x: one.matched ? one.found : one.hz,
      y: one.matched ? one.value * factor : undefined,
      label: one.label,
      isBand: one.kind === "band",
      kind: one.matched ? "matched" : "expected",
    }));
}

function matchedText(found) {
  const [lines, bands] = ["line", "band"].map((kind) => found.filter((one) => one.kind === kind));
  const n = (list) => list.filter((one) => one.matched).length;
  return `${n(lines)} of ${lines.length} lines found${bands.length ? `, with ${n(bands)} of ${bands.length} side bands` : ""}`;
}

/** What the cursors stand on, as numbers. */
export function matchTable(found, unit) {
  const rows = found.filter((one) => one.kind === "line" || one.matched).map((one) =>
    h("tr", { class: one.matched ? "matched" : "", dataset: { line: one.label, expected: one.hz, found: one.found ?? "" } }, [
      h("th", { scope: "row" }, one.label),
      h("td", null, hertz(one.hz)),
      h("td", null, one.matched ? hertz(one.found) : "–"),
      h("td", null, one.value === null ? "–" : quantity(one.value, unit)),
      h("td", null, one.over === null ? "–" : `${number(one.over, 2)} dB`),
    ]),
  );
  if (rows.length === 0) return null;
  const heads = ["Line", "Expected", "Found", "Height", "Over its surroundings"];
  return h(
    "details",
    { class: "matches" },
    h("summary", null, matchedText(found)),
    h("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": "Lines in numbers" },
      h("table", { class: "small" }, h("thead", null, h("tr", null, heads.map((t) => h("th", { scope: "col" }, t)))), h("tbody", null, rows))),
  );
}

async function spectrum(host, ctx, plot) {
  const { machine, component, rates, signal } = ctx;
  const isGear = component.kind === "gear";
  const isSlow = plot.kind === "envelope" || plot.kind === "absolute";
  const lines = linesOf(machine, component.kind === "machine" ? "shaft" : component.kind, component.kind === "machine" ? machine.shafts[0]?.id : component.id, {
    harmonics: isGear ? 1 : isSlow ? 3 : 4,
    bands: isGear ? 3 : 1,
    only: plot.only,
  });
  const highest = Math.max(...lines.map((line) => line.hz), plot.evidence.frequency_hz ?? 0);
  const lowest = isGear && lines.length ? Math.min(...lines.map((line) => line.hz)) : 0;
  const nyquist = (rates.get(plot.channel) ?? 2 * highest) / 2;
  const parameters = { kind: plot.kind, min_hz: lowest * 0.97, max_hz: highest > 0 ? Math.min(nyquist, highest * (isGear ? 1.03 : 1.12)) : null, max_points: 6000 };
  if (plot.kind === "absolute") parameters.with = plot.with;
  const path = `${channelPath(machine.id, plot.channel)}/spectrum`;
  const { answer, isNewer } = await ofWindow(path, plot.evidence, rates.get(plot.channel), parameters, signal);
  const found = match(answer, lines);
  const { factor } = shownIn(answer.unit);
  const band = plot.kind === "envelope" ? `, band ${number(answer.band_hz[0])}–${number(answer.band_hz[1])} Hz` : "";
  const title = `${NAMES[plot.kind]} of ${answer.channel}`;
  host.append(caption(title, `${component.kind === "shaft" ? "orders" : plot.only ?? "lines"} of ${component.id} marked; resolution ${number(answer.resolution_hz)} Hz${band}`, ctx, plot, isNewer));
  const made = linePlot(host, {
    title,
    x: { label: "frequency (Hz)" },
    y: { label: valueLabel(answer) },
    xValue: hertz,
    log: plot.kind !== "envelope",
    fromZero: lowest === 0,
    height: 260,
    series: [{ name: answer.channel, x: answer.frequency_hz, y: answer.value.map((v) => v * factor) }],
    cursors: cursorsOf(found, factor),
  });
  const numbers = matchTable(found, answer.unit);
  if (numbers) host.append(numbers);
  return made;
}

function caption(title, text, { machine, component }, plot, isNewer) {
  const query = new URLSearchParams({ channel: plot.channel, kind: plot.kind });
  if (["bearing", "shaft", "gear"].includes(component.kind)) query.set("lines", `${component.kind}/${component.id}${plot.only ? `#${plot.only}` : ""}`);
  return h(
    "header",
    { class: "figure" },
    h("h4", null, title),
    h("a", { href: `#/signals/${encodeURIComponent(machine.id)}?${query}` }, "Open in Signals"),
    h("p", null, text, isNewer ? "; the samples judged are no longer held, these are newer" : "; the samples judged"),
  );
}

async function scalogram(host, ctx, plot) {
  const { machine, component, rates, signal } = ctx;
  const mesh = linesOf(machine, "gear", component.id, { harmonics: 1, bands: 0 })[0]?.hz;
  const nyquist = (rates.get(plot.channel) ?? 1e4) / 2;
  const parameters = {
    revolutions: 1, n_times: 360, n_frequencies: 72,
    min_hz: mesh ? mesh / 4 : null,
    max_hz: mesh ? Math.min(0.9 * nyquist, 3.2 * mesh) : null,
    end: plot.evidence.sample_range?.[1],
  };
  const answer = await get(`${channelPath(machine.id, plot.channel)}/cwt`, parameters, signal);
  host.append(caption(`Scalogram of ${plot.channel} over one revolution`, `mesh frequency and its double marked${component.angle_deg !== undefined && component.angle_deg !== null ? `; the damage is at ${number(component.angle_deg)}°` : ""}`, ctx, plot, false));
  return heatMap(host, scalogramSpec(answer, mesh, component.angle_deg));
}

/** A scalogram as a map; over the angle where it has one. */
export function scalogramSpec(answer, mesh, angle = null) {
  const { unit, factor } = shownIn(answer.unit);
  const has = Array.isArray(answer.angle_deg);
  const across = has ? answer.angle_deg : answer.time_s;
  const marks = mesh ? [1, 2].map((k) => ({ y: k * mesh, label: k === 1 ? "GMF" : "2·GMF" })) : [];
  if (has && angle !== null && angle !== undefined) marks.push({ x: angle, label: `${number(angle)}°` });
  const turns = has ? Math.max(1, Math.round(across.at(-1) / 360)) : 0;
  return {
    title: `Scalogram of ${answer.channel}`,
    rows: answer.magnitude.map((row) => row.map((v) => (v === null ? null : v * factor))),
    valid: answer.valid_columns,
    x: has
      ? { from: 0, to: 360 * turns, label: `angle of ${answer.shaft} (°)`, name: "angle", ticks: Array.from({ length: 9 }, (_, i) => (i * 360 * turns) / 8) }
      : { from: across[0], to: across.at(-1), label: "time (s)", name: "time" },
    y: { from: answer.frequency_hz[0], to: answer.frequency_hz.at(-1), log: true, label: "frequency (Hz)", name: "frequency" },
    unit,
    marks,
    smooth: true,
  };
}

async function orbit(host, ctx, plot) {
  const parameters = { x: plot.channel, revolutions: 4, end: plot.evidence.sample_range?.[1] };
  const answer = await get(`${machinePath(ctx.machine.id)}/orbit`, parameters, ctx.signal);
  host.append(caption(`Orbit of ${answer.x_channel} and ${answer.y_channel}`, `as seen from the driver end`, ctx, plot, false));
  return orbitPlot(host, answer);
}

async function trend(host, ctx, plot) {
  const { machine, signal } = ctx;
  const { indicator, threshold, unit } = plot.evidence;
  // Where 1× points has two parts, of either sign.
  const points = indicator === "vector_1x_change";
  const feature = points ? "direction_1x_cos" : indicator.replace(/_ratio_to_baseline$/, "").replace(/_line_/, "_");
  const answer = await get(`${channelPath(machine.id, plot.channel)}/trend`, { max_points: 1000 }, signal);
  const column = answer.features.find((one) => one.name === indicator) ?? answer.features.find((one) => one.name === feature) ?? answer.features.find((one) => one.name === "rms");
  if (!column) throw new Error("no trend of it is held");
  const { factor, unit: shown } = shownIn(column.unit);
  host.append(caption(`Trend of ${column.name} of ${plot.channel}`, `windows held in memory`, ctx, plot, false));
  return linePlot(host, {
    title: `Trend of ${column.name}`,
    ...timeAxis(answer.start_time),
    y: { label: `${column.name.replaceAll("_", " ")} (${shown || "1"})` },
    fromZero: !points,
    height: 220,
    series: [{ name: column.name, x: column.time_s, y: column.value.map((v) => (v === null ? null : v * factor)), points: column.value.length < 60 }],
    limits: column.name === indicator && threshold !== null && column.unit === unit ? [{ y: threshold * factor, label: "threshold" }] : [],
  });
}

const DRAW = { envelope: spectrum, absolute: spectrum, amplitude: spectrum, scalogram, orbit, trend };

/** Draws the proof of a component into `host`; the answer ends it. */
export function proof(host, machine, component, channels) {
  const abort = new AbortController();
  const rates = new Map(channels.map((channel) => [channel.name, channel.sample_rate_hz]));
  const ctx = { machine, component, rates, signal: abort.signal };
  const made = [];
  const plots = plan(machine, component);
  for (const plot of plots) {
    const figure = h("figure", { class: "proof", dataset: { proof: plot.kind } }, loading("plot"));
    host.append(figure);
    draw(figure, plot);
  }

  async function draw(figure, plot) {
    figure.replaceChildren(loading("plot"));
    const inside = h("div", { class: "inside" });
    try {
      const one = await DRAW[plot.kind](inside, ctx, plot);
      if (abort.signal.aborted) return one.end();
      figure.replaceChildren(inside);
      made.push(one);
    } catch (error) {
      if (abort.signal.aborted) return undefined;
      figure.replaceChildren(failed(error, () => draw(figure, plot)));
    }
    return undefined;
  }

  return {
    n: plots.length,
    speed: speedOf(machine, component.kind, component.id),
    end() {
      abort.abort();
      for (const one of made) one.end();
    },
  };
}
