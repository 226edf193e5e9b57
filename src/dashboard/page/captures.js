// Raw data around alarms: what there is, as a file, and how to judge it again.

import { download, get, machinePath, post } from "./api.js";
import { signedForm } from "./acts.js";
import { badge, choice, empty, failed, field, fill, h, loading, select } from "./dom.js";
import { bytes, fault, moment, number, span } from "./format.js";
import { dialog } from "./shell.js";
import { worstFirst } from "./store.js";

const PAGE = 50;
const LOOK_MS = 5000;

/** The command that judges a file again, bit by bit. */
const again = (id) => `rotorwatch diagnose --evidence ${id}.h5`;

function fileButton(id, state) {
  const isThere = state === "complete" || state === "recovered";
  const said = h("span", { role: "status", class: "soft" });
  const fetchIt = async () => {
    said.textContent = " loading …";
    try {
      await download(`/captures/${encodeURIComponent(id)}`, `${id}.h5`);
      said.textContent = "";
    } catch (error) {
      said.textContent = ` ${error.message}`;
    }
  };
  return [h("button", { type: "button", disabled: !isThere, onclick: fetchIt }, "Download"), said];
}

/** What became of a component between two verdicts, a line each. */
function changes(then, now) {
  const of = (verdict, one) => verdict?.components?.find((other) => other.kind === one.kind && other.id === one.id);
  const words = (one) => (one ? `${fault(one.fault, one.state) || one.state}${one.severity === null ? "" : `, severity ${one.severity.toFixed(2)}`}` : "not judged");
  return worstFirst(now.components).map((one) =>
    h("tr", null, h("th", { scope: "row" }, `${one.kind} ${one.id}`), h("td", null, then ? words(of(then, one)) : "–"), h("td", null, badge(one.state), " ", words(one)), h("td", null, one.why)),
  );
}

/** Has the daemon judge a capture again, and shows what it finds beside the verdict of then. */
async function judge(id) {
  const box = h("div", null, loading("verdict: this takes some seconds"));
  const close = h("form", { method: "dialog" }, h("menu", null, h("button", { class: "primary" }, "Close")));
  const shown = dialog(`${id}, judged again`, box, close);
  try {
    const again = await post(`/captures/${encodeURIComponent(id)}/diagnosis`, null);
    const { diagnosis, then, windows, equal } = again;
    const heads = ["Component", "Then, in the newest window", "Now, over all of it", "Why"];
    fill(
      box,
      h("p", { dataset: { judged: diagnosis.state } }, badge(diagnosis.state), ` ${number(diagnosis.duration_s)} s; `, windows > 0 ? `${equal} of ${windows} windows are the same bit by bit.` : "It keeps no windows to be judged bit by bit."),
      again.made_elsewhere && h("p", { class: "note" }, again.made_elsewhere),
      h("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": "Verdicts" }, h("table", null, h("thead", null, h("tr", null, heads.map((t) => h("th", { scope: "col" }, t)))), h("tbody", null, changes(then, diagnosis)))),
    );
  } catch (error) {
    fill(box, failed(error, null));
  }
  await shown;
}

function judgeButton(id, state) {
  const isThere = state === "complete" || state === "recovered";
  return h("button", { type: "button", disabled: !isThere, dataset: { judge: id }, onclick: () => judge(id) }, "Judge again");
}

/** The capture of an alarm, or why it has none. */
export function captureLink(capture) {
  if (!capture) return h("p", { class: "soft" }, "Nothing is known yet of raw data around it.");
  if (!capture.id) return h("p", { class: "soft" }, `No raw data: ${capture.none_because}`);
  return h(
    "div",
    { class: "capture-link" },
    h("p", null, "Raw data: ", h("a", { href: `#/captures/${encodeURIComponent(capture.id)}` }, capture.id), `, ${capture.state} `, judgeButton(capture.id, capture.state), " ", fileButton(capture.id, capture.state)),
    h("p", { class: "soft" }, "Judged again by ", h("code", null, again(capture.id))),
  );
}

/** Heads of the columns; on a phone they stand before each value. */
const HEADS = ["Capture", "Machine", "At", "Because of", "Length", "Size", "State", "Windows to judge again", "File"];

function item(one, isChosen) {
  const length = one.to_s !== null && one.from_s !== null ? span(one.to_s - one.from_s) : "";
  const values = [
    one.machine,
    moment(one.trigger, one.time_unknown),
    one.cause === "alarm" ? one.alarms.map((id) => [h("a", { href: `#/alarms/${encodeURIComponent(id)}` }, id), " "]) : `${one.author}: ${one.comment ?? ""}`,
    length,
    one.bytes ? bytes(one.bytes) : "–",
    [one.state, one.note && h("span", { class: "soft" }, ` ${one.note}`)],
    number(one.windows),
    h("span", { class: "acts" }, judgeButton(one.id, one.state), fileButton(one.id, one.state)),
  ];
  return h(
    "tr",
    { class: isChosen ? "chosen" : "", dataset: { capture: one.id } },
    h("th", { scope: "row" }, one.id),
    values.map((value, i) => h("td", { dataset: { head: HEADS[i + 1] } }, h("span", null, value))),
  );
}

export function openCaptures(root, { parts, query }) {
  const wanted = parts[1] ?? null;
  let machine = query.get("machine") ?? "";
  let isClosed = false;
  let known = "";
  const bar = h("div", { class: "bar" });
  const list = h("div", { class: "card" }, loading("captures"));
  const request = h("section", { class: "card" });
  root.append(bar, list, request);

  async function ask(after = null) {
    try {
      const page = await get("/captures", { machine, limit: PAGE, after });
      const text = JSON.stringify(page);
      if (isClosed || (text === known && !after)) return;
      known = text;
      draw(page);
    } catch (error) {
      if (!isClosed) fill(list, failed(error, () => ask(after)));
    }
  }

  function draw(page) {
    if (page.items.length === 0) {
      fill(list, empty("There is no capture yet: one is made around each alarm, and when somebody asks for it below."));
      return;
    }
    fill(
      list,
      h("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": "Captures" },
        h("table", { class: "stacked" }, h("thead", null, h("tr", null, HEADS.map((t) => h("th", { scope: "col" }, t)))), h("tbody", null, page.items.map((one) => item(one, one.id === wanted))))),
      h("p", { class: "soft" }, "A file holds all that its verdicts rested on: ", h("code", null, again("CAPTURE")), " judges its windows again and must find the same."),
      page.next && h("button", { type: "button", onclick: () => ask(page.next) }, "Older"),
    );
  }

  function drawBar(state) {
    const ids = (state.machines ?? []).map((one) => one.id);
    const key = JSON.stringify([ids, machine]);
    if (bar.dataset.key === key) return;
    bar.dataset.key = key;
    fill(bar, h("h1", null, "Captures"), select([["", "all machines"], ...ids.map((id) => [id, id])], machine, (value) => {
      machine = value;
      known = "";
      ask();
    }, { "aria-label": "Machine" }));
    drawRequest(ids);
  }

  function drawRequest(ids) {
    if (ids.length === 0) return;
    let chosen = ids[0];
    let after = "10";
    const said = h("p", { role: "status", class: "soft" });
    const times = h("div", null);
    const showTimes = () => fill(times, choice("Seconds to come", [["0", "none"], ["10", "10 s"], ["60", "60 s"]], after, (value) => {
      after = value;
      showTimes();
    }));
    showTimes();
    const form = signedForm("Take a capture", async (body) => {
      const made = await post(`${machinePath(chosen)}/captures`, { ...body, after_s: Number(after) });
      said.textContent = `${made.id} is being written.`;
      ask();
    }, [
      field("Machine", select(ids.map((id) => [id, id]), chosen, (value) => (chosen = value))),
      h("div", { class: "field" }, h("span", null, "And what is to come"), times),
    ]);
    fill(request, h("h2", null, "Capture what is held now"), form, said);
  }

  ask();
  const timer = setInterval(() => document.hidden || ask(), LOOK_MS);
  return {
    update: drawBar,
    close() {
      isClosed = true;
      clearInterval(timer);
    },
  };
}
