// Pictures in the Signals view that are no lines: scalogram, waterfall, orbit.

import { channelPath, get, machinePath } from "./api.js";
import { h } from "./dom.js";
import { number, shownIn } from "./format.js";
import { heatMap } from "./heatmap.js";
import { table } from "./lines.js";
import { orbitPlot } from "./orbit.js";
import { scalogramSpec } from "./proof.js";

const ROWS = 40;
const ROW_S = 1;
const BINS = 400;

/** Wavelets by their names in the interface. */
export const WAVELETS = [
  ["morlet", "Morlet"],
  ["mexican_hat", "Mexican hat"],
  ["haar", "Haar"],
  ...[2, 4, 6, 8, 10].map((n) => [`db${n}`, `Daubechies ${n}`]),
  ...["1.3", "1.5", "2.4", "2.8", "3.5", "3.9", "4.4"].map((n) => [`bior${n}`, `Biorthogonal ${n}`]),
];

/** Bilinear distributions, the usual one first. */
export const DISTRIBUTIONS = [
  ["smoothed_pseudo_wigner_ville", "smoothed pseudo Wigner–Ville"],
  ["choi_williams", "Choi–Williams"],
  ["pseudo_wigner_ville", "pseudo Wigner–Ville"],
  ["wigner_ville", "Wigner–Ville"],
];

/** A scalogram over whole revolutions where the speed is known, else over a second. */
export async function scalogram(host, machine, choices, signal, rateHz) {
  const speed = machine.frequencies?.shaft_speed_hz;
  const parameters = {
    wavelet: choices.wavelet,
    ...(speed ? { revolutions: choices.turns ?? 1 } : { window_s: 1 }),
    n_times: 480,
    n_frequencies: 96,
    min_hz: choices.from || (speed ? 10 * speed : null),
    max_hz: choices.to || 0.4 * rateHz,
    end: choices.end,
  };
  const answer = await get(`${channelPath(machine.id, choices.channel)}/cwt`, parameters, signal);
  const mesh = table(machine).find((row) => row.label === "GMF")?.hz;
  const spec = scalogramSpec(answer, mesh);
  return heatMap(host, { ...spec, height: 400, hint: `${new Map(WAVELETS).get(answer.wavelet)} wavelet, amplitude zero-to-peak` });
}

/** A bilinear distribution; what is negative is drawn as nothing. */
export async function joint(host, machine, choices, signal, rateHz) {
  const parameters = {
    kind: choices.distribution ?? DISTRIBUTIONS[0][0],
    window_s: choices.window_s,
    n_times: 400,
    min_hz: choices.from,
    max_hz: Math.min(choices.to || rateHz / 2, rateHz / 2),
    end: choices.end,
  };
  const answer = await get(`${channelPath(machine.id, choices.channel)}/joint`, parameters, signal);
  return heatMap(host, {
    title: `${new Map(DISTRIBUTIONS).get(answer.kind)} of ${answer.channel}`,
    rows: answer.value.map((row) => row.map((value) => (value === null ? null : Math.max(0, value)))),
    x: { from: answer.time_s[0], to: answer.time_s.at(-1), label: "time (s)", name: "time" },
    y: { from: answer.frequency_hz[0], to: answer.frequency_hz.at(-1), label: "frequency (Hz)", name: "frequency" },
    unit: answer.unit,
    log: true,
    smooth: true,
    height: 400,
    hint: "power of the analytic signal; between two lines stands a third that is none",
  });
}

/** The path of a pair; the channel chosen decides which. */
export async function orbit(host, machine, choices, signal) {
  const ask = (x) => get(`${machinePath(machine.id)}/orbit`, { x, revolutions: choices.turns ?? 4, end: choices.end }, signal);
  try {
    return orbitPlot(host, await ask(choices.channel));
  } catch (error) {
    if (error.status !== 400) throw error;
    // The channel is of no pair: the machine's first one.
    const made = orbitPlot(host, await ask(null));
    host.prepend(h("p", { class: "note" }, `${choices.channel} is of no pair of sensors 90° apart; this is the machine's first pair.`));
    return made;
  }
}

/**
 * Spectra over time: those of the samples held, back from the newest, and a new one a second while the view is open; the oldest go.
 */
export function waterfall(host, machine, choices, channelOf, signal) {
  const path = `${channelPath(machine.id, choices.channel)}/spectrum`;
  /** `{end_s, value}`, oldest first. */
  const rows = [];
  let map = null;
  let unit = "";
  let to = 0;
  let isEnded = false;
  const note = h("p", { class: "note", role: "status" }, "Loading spectra of what is held …");
  host.append(note);

  const one = (end) => get(path, { kind: "amplitude", window_s: ROW_S, max_hz: choices.to, max_points: BINS, end }, signal);

  function take(answer, rateHz) {
    const end = (answer.start_sample + answer.n_samples) / rateHz;
    if (rows.some((row) => Math.abs(row.end_s - end) < 0.4 * ROW_S)) return;
    const { factor, unit: shown } = shownIn(answer.unit);
    unit = shown;
    to = answer.frequency_hz.at(-1);
    rows.push({ end_s: end, value: answer.value.map((v) => v * factor) });
    rows.sort((a, b) => a.end_s - b.end_s);
    if (rows.length > ROWS) rows.splice(0, rows.length - ROWS);
  }

  function draw() {
    if (isEnded || rows.length === 0) return;
    const newest = rows.at(-1).end_s;
    const spec = {
      title: `Waterfall of ${choices.channel}`,
      rows: rows.map((row) => row.value),
      x: { from: 0, to, label: "frequency (Hz)", name: "frequency" },
      y: { from: rows[0].end_s - newest - ROW_S, to: 0, label: "time before the newest (s)", name: "time", text: (v) => number(v, 3) },
      unit,
      log: true,
      height: 400,
      hint: `amplitude, 0-p, ${ROW_S} s a line`,
    };
    if (map) map.update(spec);
    else {
      note.remove();
      map = heatMap(host, spec);
    }
  }

  async function begin() {
    const channel = channelOf();
    const rate = channel.sample_rate_hz;
    const step = Math.round(ROW_S * rate);
    const newest = channel.end_sample;
    const began = performance.now();
    // What is held moves on meanwhile.
    const oldest = () => channel.oldest_sample + ((performance.now() - began) / 1000 + 1) * rate;
    for (let end = newest; end - step >= oldest() && rows.length < ROWS && !isEnded; end -= step) {
      try {
        take(await one(end), rate);
      } catch (error) {
        if (error.status !== 404) throw error;
        break;
      }
      if (rows.length % 5 === 1) draw();
    }
    draw();
    if (rows.length === 0) note.textContent = "No second of samples is held yet.";
  }

  return {
    ready: begin(),
    async add() {
      take(await one(null), channelOf().sample_rate_hz);
      draw();
    },
    end() {
      isEnded = true;
      map?.end();
    },
  };
}
