// All machines, the worst first: what, where, since when, how sure, and how good the data are.

import { badge, choice, empty, failed, fill, h, icon, loading } from "./dom.js";
import { fault, lasting, moment, percent, since, time } from "./format.js";
import { maintenancePill } from "./maintenance.js";
import { sparkline } from "./sparkline.js";
import { look, rank, worstFirst } from "./store.js";

/** Fleets up to this size show every component in a line of its own. */
const WIDE = 12;
/** Data older than this are told to be old, s. */
const OLD_S = 30;
const STATES = ["damaged", "warning", "undetermined", "healthy"];

const address = (machine, part) =>
  `#/machine/${encodeURIComponent(machine.id)}${part ? `/${part.kind}/${encodeURIComponent(part.id)}` : ""}`;

const worst = (machine) => worstFirst(machine.components ?? [])[0] ?? null;

function inOrder(machines) {
  const key = (m) => [rank(m.state), -(worst(m)?.severity ?? 0), m.id];
  return [...machines]
    .map((machine) => [key(machine), machine])
    .sort(([a], [b]) => a[0] - b[0] || a[1] - b[1] || a[2].localeCompare(b[2]))
    .map(([, machine]) => machine);
}

/** What is to be known of the data of a machine, the worst of it. */
export function dataNote(machine) {
  const age = machine.last_sample_time ? (Date.now() - new Date(machine.last_sample_time).getTime()) / 1000 : null;
  if (machine.source === "failed") return { state: "damaged", text: `no data: ${machine.reason ?? "source failed"}` };
  if (machine.reason) {
    const text = machine.time_unknown || age === null ? machine.reason : `no data since ${time(machine.last_sample_time)}`;
    return { state: "damaged", text };
  }
  if (machine.source === "starting" || age === null) return { state: "undetermined", text: "no data yet" };
  if (machine.data_quality === "bad") return { state: "damaged", text: "data bad" };
  if (machine.data_quality === "degraded") return { state: "warning", text: "data degraded" };
  if (machine.source === "finished") return { state: "undetermined", text: "recording at its end" };
  // A stream of another day is not late, it is a recording.
  if (!machine.time_unknown && age > OLD_S && age < 86_400 * 30) return { state: "warning", text: `newest data ${since(machine.last_sample_time)} ago` };
  return { state: "healthy", text: "data ok" };
}

function meter(severity) {
  if (severity === null || severity === undefined) return h("span", { class: "soft" }, "–");
  const level = severity >= 0.5 ? "damaged" : severity >= 0.25 ? "warning" : "healthy";
  return h("meter", { class: level, min: 0, max: 1, value: severity, "aria-label": `severity ${severity.toFixed(2)}`, title: `severity ${severity.toFixed(2)}` });
}

function component(machine, part) {
  return h(
    "li",
    { class: `component ${part.state}`, dataset: { component: `${part.kind}/${part.id}` } },
    h(
      "a",
      { href: address(machine, part) },
      icon(part.state),
      h("span", { class: "what" }, h("strong", null, part.id), h("span", { class: "soft" }, part.kind)),
      h("span", { class: `verdict ${part.state}` }, fault(part.fault, part.state) || part.state),
      h("span", { class: "soft since" }, part.since ? lasting(part.since, machine.time_unknown) : ""),
      meter(part.severity),
      h("span", { class: "soft sure" }, part.confidence === null ? "" : `${percent(part.confidence)} sure`),
    ),
    sparkline(machine.id, part),
  );
}

function chip(machine, part) {
  const title = `${part.kind} ${part.id}: ${part.state}${part.fault ? `, ${fault(part.fault, part.state)}` : ""}`;
  return h("a", { class: `chip ${part.state}`, href: address(machine, part), title }, icon(part.state), part.id);
}

function row(machine, isWide) {
  const first = worst(machine);
  const note = dataNote(machine);
  const accused = first && rank(first.state) < 2;
  const parts = worstFirst(machine.components ?? []);
  return h(
    "article",
    { class: `machine ${machine.state}`, dataset: { machine: machine.id }, "aria-label": `${machine.name || machine.id}: ${machine.state}` },
    h(
      "header",
      null,
      badge(machine.state),
      h("h2", null, h("a", { href: address(machine) }, machine.name || machine.id)),
      machine.name && h("span", { class: "soft" }, machine.id),
      machine.alarms > 0 && h("a", { class: "pill alarm", href: `#/alarms?machine=${encodeURIComponent(machine.id)}` }, `${machine.alarms} ${machine.alarms === 1 ? "alarm" : "alarms"}`),
      maintenancePill(machine.maintenance),
      machine.operating_state !== "running" && h("span", { class: "pill" }, machine.operating_state === "unknown" ? (machine.reason ? "not known whether it runs" : "not judged yet") : machine.operating_state),
      h("span", { class: `data ${note.state}` }, note.text),
      h("span", { class: "soft since", title: moment(machine.since, machine.time_unknown) }, machine.since ? `${machine.state} ${lasting(machine.since, machine.time_unknown)}` : ""),
    ),
    accused && h("p", { class: "headline" }, h("strong", null, `${first.kind} ${first.id}, ${fault(first.fault, first.state)}: `), first.why),
    parts.length === 0 && empty("No window has been judged yet: a verdict needs some seconds of samples."),
    isWide
      ? h("ul", { class: "components" }, parts.map((part) => component(machine, part)))
      : h("div", { class: "chips" }, parts.map((part) => chip(machine, part)), first && sparkline(machine.id, first)),
  );
}

/** What a row is made of; the age of data by classes, so that a row is not made anew each second. */
function signature(machine, isWide) {
  const { last_sample_time: _, stream_time_s: __, ...rest } = machine;
  const minutes = Math.floor(Date.now() / 20_000);
  return JSON.stringify([rest, dataNote(machine), isWide, minutes]);
}

export function openFleet(root) {
  const summary = h("div", { class: "summary" });
  const list = h("div", { class: "fleet" });
  const search = h("input", { type: "search", placeholder: "Machine or component", "aria-label": "Search machines", oninput: () => update(latest) });
  const filters = h("div");
  let only = null;
  let latest = null;
  const rows = new Map();

  root.append(h("div", { class: "bar" }, h("h1", null, "Fleet"), summary, search, filters), list);

  function shows(machine) {
    const text = search.value.trim().toLowerCase();
    if (only && machine.state !== only) return false;
    if (!text) return true;
    const names = [machine.id, machine.name, ...(machine.components ?? []).map((one) => one.id)];
    return names.some((name) => name?.toLowerCase().includes(text));
  }

  function drawSummary(machines) {
    const counts = STATES.map((state) => [state, machines.filter((one) => one.state === state).length]);
    const key = JSON.stringify([counts, only]);
    if (filters.dataset.key === key) return;
    filters.dataset.key = key;
    const focused = filters.contains(document.activeElement) ? document.activeElement.dataset.value : null;
    const options = [["", `all ${machines.length}`], ...counts.filter(([state, n]) => n > 0 || state === only).map(([state, n]) => [state, `${n} ${state}`])];
    fill(filters, choice("Show machines that are", options, only ?? "", (value) => {
      only = value || null;
      update(latest);
    }));
    for (const button of filters.querySelectorAll("button")) if (button.dataset.value) button.prepend(icon(button.dataset.value));
    if (focused !== null) filters.querySelector(`[data-value="${focused}"]`)?.focus();
  }

  function update(state) {
    latest = state;
    if (!state?.machines) {
      if (state?.error) fill(list, failed(state.error, look));
      else if (!list.firstChild) fill(list, loading("machines"));
      return;
    }
    drawSummary(state.machines);
    const isWide = state.machines.length <= WIDE;
    list.classList.toggle("wide", isWide);
    const shown = inOrder(state.machines.filter(shows));
    if (shown.length === 0) {
      rows.clear();
      fill(list, empty(state.machines.length === 0 ? "No machine is configured: name one by [[machine]] in the configuration." : "No machine is like that."));
      return;
    }
    const elements = shown.map((machine) => {
      const made = signature(machine, isWide);
      const known = rows.get(machine.id);
      if (known?.made === made) return known.element;
      const element = renewed(known?.element, row(machine, isWide));
      rows.set(machine.id, { made, element });
      return element;
    });
    place(list, elements);
  }

  return { update, close() {} };
}

/**
 * A row with new content in the element of old: what the browser knows of it stays, its height above all, which it
 * only guesses for a row that was never drawn; a list whose guesses change jumps under its reader.
 */
function renewed(old, fresh) {
  if (!old) return fresh;
  const link = old.contains(document.activeElement) ? document.activeElement.getAttribute("href") : null;
  old.className = fresh.className;
  old.setAttribute("aria-label", fresh.getAttribute("aria-label"));
  old.replaceChildren(...fresh.childNodes);
  if (link) old.querySelector(`a[href="${CSS.escape(link)}"]`)?.focus({ preventScroll: true });
  return old;
}

/** Puts elements in their order, moving only those that stand elsewhere: focus and scrolling stay. */
function place(list, elements) {
  const focused = list.contains(document.activeElement) ? document.activeElement : null;
  const wanted = new Set(elements);
  for (const child of [...list.children]) if (!wanted.has(child)) child.remove();
  elements.forEach((element, i) => {
    if (list.children[i] !== element) list.insertBefore(element, list.children[i] ?? null);
  });
  // An element that is moved loses it.
  if (focused && list.contains(focused)) focused.focus({ preventScroll: true });
}

export { meter };
