// What stands around the views: navigation, link to the daemon, settings, the question for a token.

import { forgetToken, hasToken, onTokenNeeded } from "./api.js";
import { choice, field, fill, h } from "./dom.js";
import { span, time } from "./format.js";
import { onPrefer, prefer, prefs } from "./prefs.js";
import { look, state } from "./store.js";

const byId = (id) => document.getElementById(id);

/** Shows a dialog until it is closed; gives its `returnValue`. */
export function dialog(title, ...children) {
  const heading = h("h2", { id: "dialog-title" }, title);
  const box = h("dialog", { "aria-labelledby": "dialog-title" }, heading, children);
  document.body.append(box);
  box.showModal();
  return new Promise((resolve) => {
    box.addEventListener("close", () => {
      box.remove();
      resolve(box.returnValue);
    });
  });
}

/** Asks for a token; `why` the last one was refused, or null if there was none. */
async function askForToken(why) {
  const input = h("input", { type: "password", name: "token", required: true, autocomplete: "off", "aria-describedby": "token-note" });
  // No submit button: the first one is what the Enter key presses.
  const cancel = h("button", { type: "button", onclick: () => form.closest("dialog").close() }, "Cancel");
  const form = h(
    "form",
    { method: "dialog" },
    h("p", { id: "token-note" }, why === null ? "The daemon needs a token. " : `The daemon refused the token: ${why}. `, "It is kept for this tab only, until it is closed."),
    field("Token", input),
    h("menu", null, cancel, h("button", { value: "use", class: "primary" }, "Use it")),
  );
  const answer = await dialog("Token", form);
  return answer === "use" ? input.value.trim() : null;
}

function settings() {
  const body = h("div", { class: "settings" });
  const row = (label, key, options) =>
    h("div", { class: "field" }, h("span", null, label), choice(label, options, prefs[key], (value) => {
      prefer({ [key]: value });
      draw();
      body.querySelector(`[aria-label="${label}"] [data-value="${value}"]`)?.focus();
    }));
  function draw() {
    fill(
      body,
      row("Look", "theme", [["auto", "as the system"], ["light", "light"], ["dark", "dark"]]),
      row("Times", "zone", [["local", "local"], ["utc", "UTC"]]),
      row("Units", "units", [["si", "SI"], ["imperial", "imperial"]]),
      hasToken() && h("button", { type: "button", onclick: () => { forgetToken(); location.reload(); } }, "Forget the token"),
    );
  }
  draw();
  dialog("Settings", body, h("form", { method: "dialog" }, h("menu", null, h("button", { class: "primary" }, "Close"))));
}

function link(view, href, text, count) {
  return h("a", { href, dataset: { view }, "aria-current": null }, text, count > 0 && h("span", { class: "count" }, String(count)));
}

/** Alarms that ask for somebody. */
export const asks = (alarm) => ["unacknowledged", "returned_unacknowledged"].includes(alarm.state);

let shownNav = "";

/** Shows where one is, how many alarms ask, and the link to the daemon. */
export function showNav(view, now) {
  const waiting = (now.alarms ?? []).filter(asks).length;
  const key = JSON.stringify([view, waiting, now.simulations.length > 0]);
  if (key !== shownNav) {
    shownNav = key;
    const links = [
      link("", "#/", "Fleet", 0),
      link("alarms", "#/alarms", "Alarms", waiting),
      link("signals", "#/signals", "Signals", 0),
      link("captures", "#/captures", "Captures", 0),
      now.simulations.length > 0 && link("simulation", "#/simulation", "Simulation", 0),
    ].filter(Boolean);
    const current = view === "machine" ? "" : view;
    for (const one of links) if (one.dataset.view === current) one.setAttribute("aria-current", "page");
    fill(byId("nav"), links);
  }
  const status = byId("link");
  const age = now.lookedAt ? (Date.now() - now.lookedAt) / 1000 : 0;
  const text =
    now.link === "live" && !now.error
      ? "live"
      : now.link === "lost"
        ? `no answer${now.lookedAt ? ` for ${span(age)}` : ""}, trying again`
        : "connecting";
  const remedy = now.link === "lost" ? now.error?.remedy : null;
  const shown = remedy ? `${now.error.message} ` : text;
  if (status.dataset.shown !== shown) {
    status.dataset.shown = shown;
    fill(status, shown, remedy && h("button", { type: "button", onclick: () => { remedy.prepare(); look(); } }, remedy.text));
  }
  status.className = `link ${now.link}`;
  status.title = now.error?.message ?? "";
  document.body.classList.toggle("stale", now.link === "lost" && Boolean(now.lookedAt));
}

/** Makes what stands around the views. */
export function buildShell() {
  onTokenNeeded(askForToken);
  byId("settings-button").addEventListener("click", settings);
  const tick = () => {
    byId("clock").textContent = time(new Date().toISOString());
    if (state.link === "lost") showNav(byId("view").dataset.view === "fleet" ? "" : byId("view").dataset.view, state);
  };
  setInterval(tick, 1000);
  onPrefer(tick);
  tick();
  window.addEventListener("online", look);
}
