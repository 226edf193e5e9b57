// Raw data around alarms: what there is, as a file, and how to judge it again.

import { download, get, machinePath, post } from "./api.js";
import { signedForm } from "./acts.js";
import { choice, empty, failed, field, fill, h, loading, select } from "./dom.js";
import { bytes, number, span, time } from "./format.js";

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

/** The capture of an alarm, or why it has none. */
export function captureLink(capture) {
  if (!capture) return h("p", { class: "soft" }, "Nothing is known yet of raw data around it.");
  if (!capture.id) return h("p", { class: "soft" }, `No raw data: ${capture.none_because}`);
  return h(
    "div",
    { class: "capture-link" },
    h("p", null, "Raw data: ", h("a", { href: `#/captures/${encodeURIComponent(capture.id)}` }, capture.id), `, ${capture.state} `, fileButton(capture.id, capture.state)),
    h("p", { class: "soft" }, "Judged again by ", h("code", null, again(capture.id))),
  );
}

function item(one, isChosen) {
  const length = one.to_s !== null && one.from_s !== null ? span(one.to_s - one.from_s) : "";
  return h(
    "tr",
    { class: isChosen ? "chosen" : "", dataset: { capture: one.id } },
    h("th", { scope: "row" }, one.id),
    h("td", null, one.machine),
    h("td", null, time(one.trigger)),
    h("td", null, one.cause === "alarm" ? one.alarms.map((id) => [h("a", { href: `#/alarms/${encodeURIComponent(id)}` }, id), " "]) : `${one.author}: ${one.comment ?? ""}`),
    h("td", null, length),
    h("td", null, one.bytes ? bytes(one.bytes) : "–"),
    h("td", null, one.state, one.note && h("span", { class: "soft" }, ` ${one.note}`)),
    h("td", null, number(one.windows)),
    h("td", null, fileButton(one.id, one.state)),
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
    const heads = ["Capture", "Machine", "At", "Because of", "Length", "Size", "State", "Windows to judge again", "File"];
    fill(
      list,
      h("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": "Captures" },
        h("table", null, h("thead", null, h("tr", null, heads.map((t) => h("th", { scope: "col" }, t)))), h("tbody", null, page.items.map((one) => item(one, one.id === wanted))))),
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
