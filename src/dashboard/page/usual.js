// What a machine's baseline holds of a channel: the heights its lines and features usually have, with their scatter.

import { get, machinePath } from "./api.js";
import { lineOfIndicator, speedOf, table } from "./lines.js";

/** Standard deviations of the logarithm shown on either side. */
const SIGMAS = 2;

/** Rows of the baseline in use, `{channel, feature, value, scatter, n}`; none where no baseline was learned. */
export async function usualOf(id, signal) {
  const list = await get(`${machinePath(id)}/baselines`, {}, signal).catch((error) => (error.status === 404 ? { items: [] } : Promise.reject(error)));
  const active = list.items.find((one) => one.active);
  if (!active) return [];
  const { usual } = await get(`${machinePath(id)}/baselines/${encodeURIComponent(active.id)}`, {}, signal);
  return usual.channel.map((channel, i) => ({
    channel,
    feature: usual.feature[i],
    value: usual.value[i],
    scatter: usual.log_scatter[i],
    n: usual.n_windows[i],
  }));
}

/** Frequency of the line that a feature is the height of; null: of none. */
function placeOf(machine, feature, kind) {
  const shaft = /^line_(\d+)x_(.+)$/.exec(feature);
  if (shaft && kind === "amplitude") {
    const speed = speedOf(machine, "shaft", shaft[2]);
    return speed ? Number(shaft[1]) * speed : null;
  }
  const bearing = /^absolute_[a-z0-9]+_(.+)$/.exec(feature);
  const label = lineOfIndicator(feature);
  if (!bearing || !label || kind !== "absolute") return null;
  return table(machine).find((row) => row.owner === bearing[1] && row.label === label)?.hz ?? null;
}

const band = (row, factor) => ({
  y: row.value * factor,
  low: row.value * Math.exp(-SIGMAS * (row.scatter ?? 0)) * factor,
  high: row.value * Math.exp(SIGMAS * (row.scatter ?? 0)) * factor,
});

/** Usual heights of lines for a spectrum of zero-to-peak amplitudes: `{x, y, low, high}`. */
export function usualLines(machine, choices, usual, factor) {
  if ((choices.detector ?? "0-p") !== "0-p") return [];
  const rows = usual.filter((row) => row.channel === choices.channel && row.value > 0);
  return rows.flatMap((row) => {
    const x = placeOf(machine, row.feature, choices.kind);
    return x ? [{ x, ...band(row, factor) }] : [];
  });
}

/** Lines across a trend: what a feature usually is. */
export function usualLevels(choices, feature, usual) {
  const row = usual.find((one) => one.channel === choices.channel && one.feature === feature && one.value !== null);
  if (!row) return [];
  const { y, high } = band(row, 1);
  return [{ y, label: "baseline", kind: "healthy" }, ...(SIGMAS * row.scatter > 0.05 ? [{ y: high, label: `baseline + ${SIGMAS}σ`, kind: "healthy" }] : [])];
}
