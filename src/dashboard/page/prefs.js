// What this browser prefers: look, zone of times, units, the operator's name. Kept in this browser only.

const KEY = "rotorwatch.preferences";
const DEFAULTS = { theme: "auto", zone: "local", units: "si", author: "" };
const listeners = new Set();

function kept() {
  try {
    return JSON.parse(localStorage.getItem(KEY)) ?? {};
  } catch {
    return {};
  }
}

export const prefs = { ...DEFAULTS, ...kept() };

/** Whether the page is dark now. */
export function isDark() {
  if (prefs.theme !== "auto") return prefs.theme === "dark";
  return matchMedia("(prefers-color-scheme: dark)").matches;
}

function show() {
  document.documentElement.dataset.theme = isDark() ? "dark" : "light";
}

/** Changes some and tells who listens. */
export function prefer(changes) {
  Object.assign(prefs, changes);
  try {
    localStorage.setItem(KEY, JSON.stringify(prefs));
  } catch {
    // A browser that keeps nothing still shows it.
  }
  show();
  for (const listener of listeners) listener();
}

/** Calls `listener` after each change until the answer is called. */
export function onPrefer(listener) {
  listeners.add(listener);
  return () => listeners.delete(listener);
}

matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => prefer({}));
show();
