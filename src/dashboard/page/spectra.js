// Kinds of lines in the Signals view: what is asked for, and what is drawn of the answer.

import { channelPath, get } from "./api.js";
import { hertz, number, shownIn, timeAxis } from "./format.js";
import { linesOf, match, peaks } from "./lines.js";
import { cursorsOf, valueLabel } from "./proof.js";
import { usualLevels, usualLines } from "./usual.js";

const MOST_POINTS = 8000;

/** Options that each kind has, beside channel and cursors. */
export const KINDS = {
  waveform: { name: "Waveform", options: ["window"], window: 0.5 },
  amplitude: { name: "Amplitude", options: ["window", "averages", "to", "detector", "log"], window: 4 },
  psd: { name: "PSD", options: ["window", "averages", "to", "log"], window: 1, log: true },
  envelope: { name: "Envelope", options: ["window", "averages", "to", "band", "log"], window: 4, to: 300 },
  absolute: { name: "Absolute", options: ["window", "averages", "to", "detector", "log"], window: 4, to: 500 },
  order: { name: "Order", options: ["window", "to", "detector", "log"], window: 8, to: 400 },
  cepstrum: { name: "Cepstrum", options: ["window", "averages"], window: 4 },
  scalogram: { name: "Scalogram", options: ["turns", "from", "to", "wavelet"] },
  joint: { name: "Wigner–Ville", options: ["window", "from", "to", "distribution"], window: 0.2 },
  waterfall: { name: "Waterfall", options: ["to"], to: 500 },
  orbit: { name: "Orbit", options: ["turns"] },
  trend: { name: "Trend", options: ["feature", "hours", "log"] },
};

export const isSpectrum = (kind) => ["amplitude", "psd", "envelope", "absolute", "order", "cepstrum"].includes(kind);

/** Asks for a spectrum or a waveform as the choices say. */
export function askLines(machine, choices, rateHz, signal) {
  const { channel, kind, window_s: window, averages, to, low, high, detector, end } = choices;
  const path = channelPath(machine.id, channel);
  if (kind === "waveform") {
    return get(`${path}/waveform`, { samples: Math.max(1, Math.round(window * rateHz)), max_points: MOST_POINTS, end }, signal);
  }
  const most = rateHz / 2;
  return get(
    `${path}/spectrum`,
    {
      kind,
      window_s: window,
      averages: KINDS[kind].options.includes("averages") ? averages : null,
      max_hz: kind === "cepstrum" ? null : Math.min(to || most, most),
      min_hz: kind === "cepstrum" ? 1 : null,
      band_low_hz: kind === "envelope" ? low : null,
      band_high_hz: kind === "envelope" ? high : null,
      detector: KINDS[kind].options.includes("detector") ? detector : null,
      max_points: MOST_POINTS,
      end,
    },
    signal,
  );
}

/** x of a spectrum: frequencies, orders or quefrencies (ms). */
function across(answer) {
  if (answer.order) return answer.order;
  if (answer.quefrency_s) return answer.quefrency_s.map((q) => q * 1000);
  return answer.frequency_hz;
}

/** Place of a frequency on the axis of a spectrum. */
function placeOn(answer) {
  if (answer.order) return (hz) => hz / answer.shaft_speed_hz;
  if (answer.quefrency_s) return (hz) => 1000 / hz;
  return (hz) => hz;
}

/** Lines to mark, of the component chosen. */
function linesFor(machine, choices) {
  if (!choices.lines) return [];
  const [part, only = null] = choices.lines.split("#");
  const [kind, ...rest] = part.split("/");
  const options = { harmonics: choices.harmonics ?? 3, bands: choices.bands ?? 1, only };
  return linesOf(machine, kind, rest.join("/"), options);
}

/** In a cepstrum a family of lines is one peak at 1/spacing: each line counts once. */
function inCepstrum(answer, lines) {
  const families = lines.filter((one) => one.kind === "line" && ["BPFO", "BPFI", "2·BSF", "FTF", "GMF", "1×"].includes(one.label));
  return families.map((one) => ({ ...one, found: null, matched: false, value: null, over: null }));
}

/** What is drawn of an answer: the plot and the lines found in it. */
export function specOf(machine, choices, answer, reference, usual = []) {
  const { unit, factor } = shownIn(answer.unit);
  if (choices.kind === "waveform") {
    const start = answer.time_s[0];
    return {
      found: [],
      spec: {
        title: `Waveform of ${answer.channel}`,
        x: { label: "time (s)" },
        xValue: (t) => `${number(t, 5)} s`,
        y: { label: `${answer.channel} (${unit})` },
        yValue: (v) => `${number(v)} ${unit}`,
        height: 360,
        hint: `from ${number(start, 6)} s of the stream${answer.decimated ? "; thinned to extremes" : ""}`,
        series: [{ name: answer.channel, x: answer.time_s.map((t) => t - start), y: answer.value.map((v) => v * factor) }],
      },
    };
  }
  const lines = linesFor(machine, choices);
  const place = placeOn(answer);
  const found = answer.quefrency_s ? inCepstrum(answer, lines) : match(answer, lines);
  const cursors = cursorsOf(found, factor).map((one) => ({ ...one, x: place(one.x) }));
  const tops = choices.peaks > 0 && !answer.quefrency_s ? peaks(answer, choices.peaks, 1) : [];
  cursors.push(...tops.map((one) => ({ x: place(one.hz), y: one.value * factor, label: number(place(one.hz), 4), kind: "shaft" })));
  const label = answer.order ? `order of the shaft at ${hertz(answer.shaft_speed_hz)}` : answer.quefrency_s ? "quefrency (ms)" : "frequency (Hz)";
  const bars = usualLines(machine, choices, usual, factor);
  const xs = across(answer);
  const series = [{ name: answer.channel, x: xs, y: answer.value.map((v) => v * factor) }];
  if (reference && reference.kind === answer.kind && reference.unit === answer.unit) {
    series.push({ name: "reference", x: across(reference), y: reference.value.map((v) => v * factor), ink: "reference", width: 1 });
  }
  return {
    found,
    peaks: tops,
    spec: {
      title: `${KINDS[choices.kind].name} spectrum of ${answer.channel}`,
      x: { label },
      xValue: (x) => (answer.order ? `order ${number(x, 4)}` : answer.quefrency_s ? `${number(x, 4)} ms (${hertz(1000 / x)})` : hertz(x)),
      y: { label: valueLabel(answer) },
      log: choices.log === true && !answer.quefrency_s,
      logX: choices.logX === true && !answer.quefrency_s,
      fromZero: !answer.quefrency_s,
      height: 360,
      hint: `${facts(answer)}${bars.length ? "; green: the baseline ± 2σ" : ""}`,
      usual: bars,
      series: choices.logX ? series.map((one) => positive(one)) : series,
      cursors,
    },
  };
}

/** Without what a logarithmic axis cannot show. */
function positive(one) {
  const from = one.x.findIndex((x) => x > 0);
  return { ...one, x: one.x.slice(Math.max(0, from)), y: one.y.slice(Math.max(0, from)) };
}

/** What a spectrum rests on. */
export function facts(answer) {
  const parts = [
    `resolution ${number(answer.resolution_hz)} Hz`,
    answer.window === "none" ? null : `${answer.window} window`,
    `${answer.averages} ${answer.averages === 1 ? "window" : "windows averaged"}`,
    answer.kind === "envelope" ? `band ${number(answer.band_hz[0])}–${number(answer.band_hz[1])} Hz` : null,
    answer.angle_from ? { mark: "angle by the tacho's mark", tacho: "angle by the tacho", speed: "angle by the speed, taken as constant" }[answer.angle_from] : null,
    answer.validity === "ok" ? null : { gap: "fewer samples than asked for", clipped: "samples are clipped", stale: "the source failed: old samples" }[answer.validity],
  ];
  return parts.filter(Boolean).join("; ");
}

/** Features of a channel, or of a component, over time. */
export async function askTrend(machine, choices, signal) {
  const hours = Number(choices.hours ?? 0);
  const from = hours ? new Date(Date.now() - hours * 3_600_000).toISOString() : null;
  return get(`${channelPath(machine.id, choices.channel)}/trend`, { from, max_points: 2000 }, signal);
}

const isSet = (value) => value !== null && value !== undefined;

/** The trend of one feature, with its limits and the alarms of its machine. */
export function trendSpec(choices, answer, alarms, usual) {
  const column = answer.features.find((one) => one.name === choices.feature) ?? answer.features.find((one) => one.name === "rms") ?? answer.features[0];
  if (!column) return null;
  const { unit, factor } = shownIn(column.unit);
  const scaled = (values) => values.map((v) => (v === null ? null : v * factor));
  const series = [{ name: column.name, x: column.time_s, y: scaled(column.value), points: column.value.length < 80 }];
  if (column.high.length > 0) {
    series.push({ name: "largest", x: column.time_s, y: scaled(column.high), ink: "reference", width: 1 });
    series.push({ name: "smallest", x: column.time_s, y: scaled(column.low), ink: "reference", width: 1 });
  }
  return {
    title: `Trend of ${column.name} of ${answer.channel}`,
    ...timeAxis(answer.start_time),
    y: { label: `${column.name.replaceAll("_", " ")} (${unit || "1"})` },
    log: choices.log === true,
    fromZero: true,
    height: 360,
    hint: `${answer.n_windows} ${answer.tier === "raw" ? "windows" : answer.tier === "1min" ? "minutes" : "hours"}${answer.gaps.length ? `, ${answer.gaps.length} gaps` : ""}`,
    series,
    limits: usualLevels(choices, column.name, usual).map((one) => ({ ...one, y: one.y * factor })),
    cursors: alarms.filter((one) => isSet(one.raised_at_s)).map((one) => ({ x: one.raised_at_s, label: `alarm ${one.component}`, kind: "mark" })),
    feature: column.name,
  };
}
