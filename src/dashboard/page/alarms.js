// Alarms that stand, and what happened before: acknowledge, shelve, why, evidence, capture.

import { get } from "./api.js";
import { actButtons } from "./acts.js";
import { badge, choice, empty, failed, fill, h, loading, select } from "./dom.js";
import { captureLink } from "./captures.js";
import { fault, moment, raised, time, words } from "./format.js";
import { asks } from "./shell.js";
import { look, rank } from "./store.js";

const PAGE = 50;

/** Where the part that an alarm is about is shown. */
function place(alarm) {
  const machine = `#/machine/${encodeURIComponent(alarm.machine)}`;
  return ["bearing", "shaft", "gear", "machine", "sensor"].includes(alarm.kind)
    ? `${machine}/${alarm.kind}/${encodeURIComponent(alarm.component)}`
    : machine;
}

function stateText(alarm) {
  const { acknowledgement: ack, silenced } = alarm;
  if (silenced) return `${words(alarm.state)} by ${silenced.author}${silenced.until ? ` until ${time(silenced.until)}` : ""}${silenced.comment ? `: ${silenced.comment}` : ""}`;
  if (ack) return `${words(alarm.state)}; acknowledged by ${ack.author}${ack.comment ? `: ${ack.comment}` : ""}`;
  return words(alarm.state);
}

/** An alarm in two lines, where its component is shown. */
export function alarmLine(alarm) {
  return h(
    "div",
    { class: `alarm-line ${alarm.level}`, dataset: { alarm: alarm.id } },
    h("p", null, h("strong", null, "Alarm "), h("a", { href: `#/alarms/${encodeURIComponent(alarm.id)}` }, alarm.id), ` raised ${alarm.time_unknown ? "at " : ""}${moment(alarm.raised_at, alarm.time_unknown)}; ${stateText(alarm)}`),
    actButtons(alarm),
  );
}

function inOrder(alarms) {
  const key = (alarm) => (asks(alarm) ? 0 : alarm.silenced ? 2 : 1);
  return [...alarms].sort((a, b) => key(a) - key(b) || rank(a.level) - rank(b.level) || b.raised_at.localeCompare(a.raised_at));
}

function card(alarm, isOpen) {
  const more = h("div", { class: "more" });
  const box = h("details", { open: isOpen, ontoggle: () => box.open && more.childElementCount === 0 && story(more, alarm) }, h("summary", null, "History and raw data"), more);
  return h(
    "article",
    { class: `alarm ${alarm.level}${asks(alarm) ? " asks" : ""}`, dataset: { alarm: alarm.id } },
    h(
      "header",
      null,
      badge(alarm.level),
      h("h2", null, h("a", { href: place(alarm) }, `${alarm.machine} · ${alarm.component}`)),
      h("span", { class: "verdict" }, alarm.source === "diagnosis" ? fault(alarm.fault, alarm.level) : alarm.source === "limit" ? `limit ${alarm.limit ?? ""}` : alarm.source === "data" ? "no data" : "store"),
      h("span", { class: "pill" }, alarm.active ? "present" : "gone"),
      h("span", { class: "soft since" }, `raised ${raised(alarm.raised_at, alarm.time_unknown)}${alarm.occurrences > 1 ? `, came ${alarm.occurrences} times` : ""}`),
    ),
    h("p", { class: "why" }, alarm.why),
    h("p", { class: "soft state-text" }, stateText(alarm)),
    actButtons(alarm),
    box,
  );
}

async function story(host, alarm) {
  fill(host, loading("history"));
  try {
    const detail = await get(`/alarms/${encodeURIComponent(alarm.id)}`);
    const done = new Map(detail.actions.map((action) => [action.sequence, action]));
    const items = detail.transitions.map((one) => {
      const action = done.get(one.sequence);
      return h("li", null, h("time", { class: "soft" }, moment(one.time, alarm.time_unknown)), " ", words(one.event), ` → ${words(one.state)}, ${one.level}`, action && ` by ${action.author}${action.comment ? `: ${action.comment}` : ""}`);
    });
    fill(host, captureLink(detail.capture), h("p", null, h("a", { href: place(alarm) }, "Evidence and plots")), h("ol", { class: "story" }, items));
  } catch (error) {
    fill(host, failed(error, () => story(host, alarm)));
  }
}

export function openAlarms(root, { parts, query }) {
  const wanted = parts[1] ?? null;
  let tab = "standing";
  let machine = query.get("machine") ?? "";
  let latest = null;
  let cards = new Map();
  const bar = h("div", { class: "bar" });
  const list = h("div", { class: "alarms" }, loading("alarms"));
  root.append(bar, list);

  function drawBar(state) {
    const key = JSON.stringify([tab, machine, state.machines?.map((one) => one.id), state.alarms?.length]);
    if (bar.dataset.key === key) return;
    bar.dataset.key = key;
    const focused = bar.contains(document.activeElement) ? (document.activeElement.dataset.value ?? "select") : null;
    const machines = [["", "all machines"], ...(state.machines ?? []).map((one) => [one.id, one.name || one.id])];
    fill(
      bar,
      h("h1", null, "Alarms"),
      choice("Which alarms", [["standing", `standing ${state.alarms?.length ?? ""}`], ["history", "history"]], tab, (value) => {
        tab = value;
        cards = new Map();
        fill(list, loading("alarms"));
        if (tab === "history") history(null);
        update(latest);
      }),
      select(machines, machine, (value) => {
        machine = value;
        if (tab === "history") history(null);
        update(latest);
      }, { "aria-label": "Machine" }),
    );
    if (focused) (bar.querySelector(`[data-value="${focused}"]`) ?? bar.querySelector("select"))?.focus();
  }

  async function history(after) {
    if (!after) fill(list, loading("history"));
    try {
      const page = await get("/alarms/history", { machine, limit: PAGE, after });
      if (tab !== "history") return;
      if (!after) fill(list, h("ol", { class: "card story" }));
      const story_ = list.querySelector("ol");
      list.querySelector(".next")?.remove();
      for (const one of page.items) {
        story_.append(h("li", null, h("time", { class: "soft" }, moment(one.time, one.alarm.time_unknown)), " ", badge(one.alarm.level), " ", h("a", { href: place(one.alarm) }, `${one.alarm.machine} · ${one.alarm.component}`), ` ${words(one.event)}`, one.author && ` by ${one.author}${one.comment ? `: ${one.comment}` : ""}`, h("span", { class: "soft" }, ` → ${words(one.alarm.state)}`)));
      }
      if (!story_.firstChild) fill(list, empty("Nothing has happened yet."));
      if (page.next) list.append(h("button", { type: "button", class: "next", onclick: () => history(page.next) }, "Older"));
    } catch (error) {
      fill(list, failed(error, () => history(after)));
    }
  }

  function update(state) {
    latest = state;
    drawBar(state);
    if (tab !== "standing") return;
    if (!state.alarms) {
      if (state.error) fill(list, failed(state.error, look));
      return;
    }
    const shown = inOrder(state.alarms.filter((alarm) => !machine || alarm.machine === machine));
    if (shown.length === 0) {
      cards = new Map();
      fill(list, empty("No alarm stands", machine ? ` of ${machine}` : "", ". What happened before is in the history."));
      return;
    }
    const elements = shown.map((alarm) => {
      const key = JSON.stringify(alarm);
      const known = cards.get(alarm.id);
      if (known?.key === key) return known.element;
      const isOpen = known ? known.element.querySelector("details").open : alarm.id === wanted;
      const element = card(alarm, isOpen);
      cards.set(alarm.id, { key, element });
      return element;
    });
    const same = elements.length === list.children.length && elements.every((element, i) => list.children[i] === element);
    if (same) return;
    const focused = list.contains(document.activeElement) ? document.activeElement.getAttribute("aria-label") : null;
    const isFirst = cards.isShown !== true;
    fill(list, elements);
    cards.isShown = true;
    if (focused) list.querySelector(`[aria-label="${CSS.escape(focused)}"]`)?.focus();
    if (wanted && isFirst) list.querySelector(`[data-alarm="${CSS.escape(wanted)}"]`)?.scrollIntoView({ block: "start" });
  }

  return { update };
}
