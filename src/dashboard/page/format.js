// Numbers, units and times as people read them.

import { prefs } from "./prefs.js";

/** What a unit is shown as, and by what its values are divided then. */
const IMPERIAL = { "m/s^2": ["g", 9.80665], "mm/s": ["in/s", 25.4], um: ["mil", 25.4], mm: ["in", 25.4] };
const SIGNS = { "m/s^2": "m/s²", um: "µm", "1": "" };

/** How values of a unit are shown: its name, and the factor for values. */
export function shownIn(unit) {
  const density = /^\((.*)\)\^2\/Hz$/.exec(unit);
  if (density) {
    const base = shownIn(density[1]);
    return { unit: `(${base.unit})²/Hz`, factor: base.factor ** 2 };
  }
  const other = prefs.units === "imperial" && IMPERIAL[unit];
  return other ? { unit: other[0], factor: 1 / other[1] } : { unit: SIGNS[unit] ?? unit, factor: 1 };
}

/** Three figures, with a power of ten where there were more than five places. */
export function number(value, figures = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e6 || size < 1e-3) {
    const [digits, power] = value.toExponential(figures - 1).split("e");
    return `${Number(digits)}·10${superscript(Number(power))}`;
  }
  const places = Math.max(0, figures - 1 - Math.floor(Math.log10(size)));
  return value.toFixed(Math.min(places, 6)).replace(/(\.\d*?)0+$/, "$1").replace(/\.$/, "");
}

function superscript(power) {
  const signs = { "-": "⁻", 0: "⁰", 1: "¹", 2: "²", 3: "³", 4: "⁴", 5: "⁵", 6: "⁶", 7: "⁷", 8: "⁸", 9: "⁹" };
  return [...String(power)].map((sign) => signs[sign]).join("");
}

/** A value with its unit, converted. */
export function quantity(value, unit, figures = 3) {
  const shown = shownIn(unit);
  const text = number(value === null || value === undefined ? null : value * shown.factor, figures);
  return shown.unit && text !== "–" ? `${text} ${shown.unit}` : text;
}

export const hertz = (value) => (value === null || value === undefined ? "–" : `${number(value, 4)} Hz`);
export const percent = (value) => (value === null || value === undefined ? "–" : `${Math.round(value * 100)} %`);

const FAULTS = { rolling_element: "rolling element", abnormal_level: "abnormal, cause not proven" };

export const words = (name) => FAULTS[name] ?? (name ?? "").replaceAll("_", " ");
export const fault = (name, state) =>
  name ? words(name) : state === "warning" || state === "damaged" ? "cause not proven" : "";

const two = (value) => String(value).padStart(2, "0");

/** A time of day with its date, in the zone preferred. */
export function time(text, { date = true, seconds = true } = {}) {
  if (!text) return "–";
  const at = new Date(text);
  if (Number.isNaN(at.getTime())) return text;
  const utc = prefs.zone === "utc";
  const [y, mo, d, h, mi, s] = utc
    ? [at.getUTCFullYear(), at.getUTCMonth(), at.getUTCDate(), at.getUTCHours(), at.getUTCMinutes(), at.getUTCSeconds()]
    : [at.getFullYear(), at.getMonth(), at.getDate(), at.getHours(), at.getMinutes(), at.getSeconds()];
  const clock = `${two(h)}:${two(mi)}${seconds ? `:${two(s)}` : ""}${utc ? " UTC" : ""}`;
  return date ? `${y}-${two(mo + 1)}-${two(d)} ${clock}` : clock;
}

/** A span of time in its two largest units. */
export function span(seconds) {
  if (!Number.isFinite(seconds)) return "–";
  if (seconds < 0) return "0 s";
  if (seconds < 60) return `${Math.floor(seconds)} s`;
  const [minutes, hours, days] = [seconds / 60, seconds / 3600, seconds / 86400].map(Math.floor);
  if (hours < 1) return `${minutes} min`;
  if (days < 1) return `${hours} h ${minutes % 60} min`;
  return `${days} d ${hours % 24} h`;
}

/** How long ago something was. */
export const since = (text) => (text ? span((Date.now() - new Date(text).getTime()) / 1000) : "–");

/** Where in its record a time is whose stream told no start: such times count from 1970-01-01. */
const inRecord = (text) => `${(new Date(text).getTime() / 1000).toFixed(1)} s of the record`;

/** A time; `isRecord`: the start of its stream is unknown (`time_unknown`), so it is a place in the record. */
export const moment = (text, isRecord) => (text && isRecord ? inRecord(text) : time(text));

/** How long something has been so; in a record of an unknown day, from where on. */
export const lasting = (text, isRecord) => (isRecord ? `from ${inRecord(text)} on` : `for ${since(text)}`);

/** When something was and how long ago that is; in a record of an unknown day, where. */
export const raised = (text, isRecord) => (isRecord ? `at ${inRecord(text)}` : `${time(text)}, ${since(text)} ago`);

/** How a plot tells times that count from `startTime`; `null`: of a record of an unknown day, in its seconds. */
export function timeAxis(startTime) {
  if (!startTime) return { x: { label: "time in the record (s)" }, xValue: (t) => `${number(t, 5)} s of the record` };
  const at = (t) => new Date(new Date(startTime).getTime() + t * 1000).toISOString();
  return {
    x: { label: prefs.zone === "utc" ? "time (UTC)" : "time (local)" },
    xTick: (t) => time(at(t), { date: false }).replace(" UTC", ""),
    xValue: (t) => time(at(t)),
  };
}

export function bytes(count) {
  const units = ["B", "kB", "MB", "GB", "TB"];
  let value = count;
  let unit = 0;
  while (value >= 1000 && unit < units.length - 1) {
    value /= 1000;
    unit += 1;
  }
  return `${number(value)} ${units[unit]}`;
}
