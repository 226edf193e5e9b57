// One machine: its drivetrain by state, and of the part chosen the verdict, the sentence why, the proof.

import { get, machinePath } from "./api.js";
import { alarmLine } from "./alarms.js";
import { badge, empty, failed, fill, h, icon, loading } from "./dom.js";
import { drivetrain } from "./drivetrain.js";
import { dataNote, meter } from "./fleet.js";
import { fault, hertz, lasting, moment, number, percent, quantity, since, span, timeAxis, words } from "./format.js";
import { feedback } from "./feedback.js";
import { maintenanceButton, maintenanceNote } from "./maintenance.js";
import { linePlot } from "./plot.js";
import { proof } from "./proof.js";
import { alarmsOf, machineOf, worstFirst } from "./store.js";

/** Time between two looks at the diagnosis while nothing changes. */
const FRESH_MS = 5000;

export function openMachine(root, { parts }) {
  const [, id, kind, part] = parts;
  const head = h("header", { class: "machine-head" });
  const picture = h("section", { class: "card picture", "aria-label": "Drivetrain" }, loading("machine"));
  const list = h("section", { class: "card parts", "aria-label": "Components" });
  const detail = h("section", { class: "card detail", "aria-live": "off" }, loading("verdict"));
  root.append(head, h("div", { class: "machine-grid" }, picture, list), detail);

  let machine = null;
  let channels = [];
  let diagnosis = null;
  let askedAt = 0;
  let isAsking = false;
  let isClosed = false;
  let shown = null;
  let made = {};

  const chosen = () => {
    const components = diagnosis?.components ?? [];
    const named = components.find((one) => one.kind === kind && one.id === part);
    return named ?? worstFirst(components)[0] ?? null;
  };
  const choose = (newKind, newPart) => {
    location.hash = `#/machine/${encodeURIComponent(id)}/${newKind}/${encodeURIComponent(newPart)}`;
  };

  async function ask() {
    if (isAsking) return;
    isAsking = true;
    try {
      const [description, verdict, list] = await Promise.all([
        get(machinePath(id)),
        get(`${machinePath(id)}/diagnosis`).catch((error) => (error.status === 404 ? null : Promise.reject(error))),
        get(`${machinePath(id)}/channels`),
      ]);
      askedAt = Date.now();
      if (isClosed) return;
      machine = description;
      channels = list.items;
      diagnosis = asOfNow(verdict, machineOf(id));
      draw();
    } catch (error) {
      if (!machine && !isClosed) fill(picture, failed(error, ask));
    } finally {
      isAsking = false;
    }
  }

  /** Runs `make` only if `data` differ from those of the last time. */
  function whenChanged(name, data, make) {
    const text = JSON.stringify(data);
    if (made[name] === text) return;
    made = { ...made, [name]: text };
    make();
  }

  function drawHead(item) {
    const speed = diagnosis?.shaft_speed_hz;
    const note = item ? dataNote(item) : { state: "undetermined", text: "" };
    const facts = [
      item?.since && `${item.state} ${lasting(item.since, item.time_unknown)}`,
      speed && `${hertz(speed)} (${number(speed * 60, 4)} r/min), ${words(diagnosis.speed_source)}`,
      diagnosis && words(diagnosis.operating_state),
    ].filter(Boolean);
    whenChanged("head", [item?.state, item?.maintenance, facts, note, machine?.name], () =>
      fill(
        head,
        h("p", { class: "crumb" }, h("a", { href: "#/" }, "Fleet"), " / "),
        h("h1", null, machine?.name || id),
        badge(item?.state ?? "undetermined"),
        h("span", { class: "soft" }, facts.join(" · ")),
        h("span", { class: `data ${note.state}` }, note.text),
        h("a", { class: "button", href: `#/signals/${encodeURIComponent(id)}` }, "Signals"),
        item && maintenanceButton(id, item.maintenance),
        maintenanceNote(item?.maintenance),
      ),
    );
  }

  function draw() {
    const component = chosen();
    const states = new Map((diagnosis?.components ?? []).map((one) => [`${one.kind}/${one.id}`, one.state]));
    whenChanged("picture", [machine, [...states], component?.kind, component?.id], () => {
      const focused = picture.contains(document.activeElement) ? document.activeElement.dataset.part : null;
      fill(picture, drivetrain(machine, states, component, choose), legend());
      if (focused) picture.querySelector(`[data-part="${CSS.escape(focused)}"]`)?.focus();
    });
    whenChanged("list", [diagnosis?.components.map((one) => [one.id, one.kind, one.state, one.fault, one.severity]), component?.id, component?.kind], () => drawList(component));
    const item = machineOf(id);
    drawHead(item);
    if (!component) {
      fill(detail, empty(["damaged", "warning"].includes(item?.state)
        ? "What was accused before the last start stands, and the alarms say why; no window of this machine has been judged since."
        : "No window of this machine has been judged yet: a verdict needs some seconds of samples."));
      return;
    }
    drawDetail(component);
  }

  function drawList(component) {
    const focused = list.contains(document.activeElement) ? document.activeElement.getAttribute("href") : null;
    const items = worstFirst(diagnosis?.components ?? []).map((one) =>
      h("li", null, h(
        "a",
        { class: `part-link ${one.state}`, href: `#/machine/${encodeURIComponent(id)}/${one.kind}/${encodeURIComponent(one.id)}`, "aria-current": one === component ? "true" : null },
        icon(one.state),
        h("span", { class: "what" }, h("strong", null, one.id), h("span", { class: "soft" }, one.kind)),
        h("span", { class: `verdict ${one.state}` }, fault(one.fault, one.state) || one.state),
        meter(one.severity),
      )),
    );
    fill(list, h("h2", null, "Components"), items.length ? h("ul", null, items) : empty("None has been judged yet."));
    if (focused) list.querySelector(`a[href="${CSS.escape(focused)}"]`)?.focus();
  }

  function drawDetail(component) {
    const verdict = [component.state, component.fault, component.why];
    // Numbers move with each window; the plots are drawn anew only with another verdict, or when asked to.
    const isNew = !shown || shown.key !== `${component.kind}/${component.id}` || JSON.stringify(shown.verdict.slice(0, 2)) !== JSON.stringify(verdict.slice(0, 2));
    if (isNew) {
      shown?.proof?.end();
      shown?.trend?.end();
      shown = { key: `${component.kind}/${component.id}`, verdict, words: h("div"), figures: h("div", { class: "figures" }), evidence: h("div"), feedback: feedback(id, component) };
      fill(
        detail,
        shown.words,
        shown.feedback,
        h("div", { class: "row" }, h("h3", null, "Proof"), h("button", { type: "button", onclick: again }, "Newest window")),
        shown.figures,
        shown.evidence,
      );
      shown.proof = proof(shown.figures, machine, component, channels);
      const figure = h("figure", { class: "proof", dataset: { proof: "severity" } });
      shown.figures.append(figure);
      severityTrend(figure, component);
    }
    drawWords(component);
    whenChanged("evidence", component.evidence, () => fill(shown.evidence, evidenceTable(component)));
    if (isNew) fill(shown.evidence, evidenceTable(component));
  }

  function drawWords(component) {
    const item = machineOf(id)?.components?.find((one) => one.kind === component.kind && one.id === component.id);
    const data = [shown.key, component.why, component.state, component.severity, alarmsOf(id, component.kind, component.id), item?.since, Math.floor(Date.now() / 10_000)];
    whenChanged("words", data, () => {
      const focused = shown.words.contains(document.activeElement) ? document.activeElement.dataset.act : null;
      fill(shown.words, sentence(component, item?.since));
      if (focused) shown.words.querySelector(`[data-act="${focused}"]`)?.focus();
    });
  }

  /** Draws the proof of the newest window judged. */
  function again() {
    shown.verdict = [null];
    ask();
  }

  async function severityTrend(figure, component) {
    fill(figure, loading("trend"));
    const mine = shown;
    try {
      const path = `${machinePath(id)}/components/${component.kind}/${encodeURIComponent(component.id)}/trend`;
      const answer = await get(path, { features: "severity", max_points: 1000 });
      if (isClosed || shown !== mine) return;
      const column = answer.features[0];
      if (!column || column.time_s.length < 2) {
        fill(figure, empty("Too short a history for a trend of the severity."));
        return;
      }
      const marks = alarmsOf(id, component.kind, component.id).map((alarm) => ({ x: alarm.raised_at_s, label: "alarm raised", kind: "mark" }));
      const inside = h("div", { class: "inside" }, h("header", { class: "figure" }, h("h4", null, `Severity of ${component.id}`), h("p", null, `${span(column.time_s.at(-1) - column.time_s[0])}; warning from 0.25, damaged from 0.5`)));
      fill(figure, inside);
      mine.trend = linePlot(inside, {
        title: `Severity of ${component.id} over time`,
        ...timeAxis(answer.start_time),
        y: { label: "severity (1)" },
        fromZero: true,
        height: 200,
        series: [{ name: "severity", x: column.time_s, y: column.value, points: column.value.length < 60 }],
        limits: [{ y: 0.25, label: "warning", kind: "warning" }, { y: 0.5, label: "damaged", kind: "damaged" }],
        cursors: marks,
      });
    } catch (error) {
      if (!isClosed && shown === mine) fill(figure, failed(error, () => severityTrend(figure, component)));
    }
  }

  function sentence(component, begin) {
    const alarms = alarmsOf(id, component.kind, component.id);
    return [
      h("div", { class: "row verdict-row" }, badge(component.state), h("h2", null, `${component.kind} ${component.id}`, component.fault || component.state === "damaged" || component.state === "warning" ? `: ${fault(component.fault, component.state)}` : "")),
      h("p", { class: "why" }, component.why),
      h(
        "dl",
        { class: "facts" },
        fact("Severity", component.severity === null ? "not judged" : [component.severity.toFixed(2), " ", meter(component.severity)]),
        fact("Confidence", component.confidence === null ? "not judged" : percent(component.confidence)),
        fact("Since", sinceWhen(begin, machineOf(id)?.time_unknown)),
        component.tooth ? fact("Tooth", String(component.tooth)) : null,
        component.angle_deg !== null && component.angle_deg !== undefined ? fact("Angle", `${number(component.angle_deg)}°`) : null,
      ),
      component.other_faults.length > 0 &&
        h("p", null, "Beside it: ", component.other_faults.map((other) => `${words(other.fault)} (severity ${other.severity?.toFixed(2)}, ${percent(other.confidence)} sure): ${other.why}`).join("; ")),
      alarms.map((alarm) => alarmLine(alarm)),
    ];
  }

  ask();
  return {
    update(state) {
      drawHead(machineOf(id));
      const component = chosen();
      if (component && shown) drawWords(component);
      if (state.machines && !machineOf(id)) fill(picture, empty(`No machine has the id ${id}.`));
      else if (Date.now() - askedAt > FRESH_MS || worse(state)) ask();
    },
    close() {
      isClosed = true;
      shown?.proof?.end();
      shown?.trend?.end();
    },
  };

  /** Whether the list of machines knows a state that the diagnosis shown does not. */
  function worse(state) {
    const known = state.machines?.find((one) => one.id === id);
    return diagnosis && known && known.state !== diagnosis.state;
  }
}

/** A verdict with what is known of each component now: while no data come, healthy ones are undetermined. */
function asOfNow(verdict, item) {
  if (!verdict?.no_data || !item) return verdict;
  const now = (one) => item.components?.find((other) => other.kind === one.kind && other.id === one.id);
  const components = verdict.components.map((one) => ({ ...one, ...(({ state, why, severity, confidence }) => ({ state, why, severity, confidence }))(now(one) ?? one) }));
  return { ...verdict, state: item.state, operating_state: item.operating_state, components };
}

const fact = (name, value) => h("div", null, h("dt", null, name), h("dd", null, value));
const sinceWhen = (begin, isRecord) =>
  begin ? `${moment(begin, isRecord)}${isRecord ? "" : ` (${since(begin)})`}` : "–";

function legend() {
  return h("p", { class: "legend" }, ["damaged", "warning", "healthy", "undetermined"].map((state) => h("span", { class: `verdict ${state}` }, icon(state), state)), h("span", null, h("i", { class: "sensor-sign" }), "sensor"));
}

function evidenceTable(component) {
  if (component.evidence.length === 0) return empty("This verdict rests on no single number.");
  const heads = ["Indicator", "Channel", "Line", "Value", "Held against", "False-alarm probability"];
  const rows = component.evidence.map((one) => {
    const over = one.threshold !== null && one.value !== null && one.value >= one.threshold;
    return h("tr", { class: over ? "over" : "" }, [
      h("th", { scope: "row" }, words(one.indicator)),
      h("td", null, one.channel.replace("+", " + ")),
      h("td", null, hertz(one.frequency_hz ?? one.expected_hz)),
      h("td", null, quantity(one.value, one.unit)),
      h("td", null, one.threshold === null ? "–" : quantity(one.threshold, one.unit)),
      h("td", null, one.false_alarm_probability === null ? "–" : number(one.false_alarm_probability, 2)),
    ]);
  });
  return h(
    "details",
    { class: "evidence" },
    h("summary", null, `${component.evidence.length} numbers this rests on`),
    h("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": "Evidence" }, h("table", null, h("thead", null, h("tr", null, heads.map((t) => h("th", { scope: "col" }, t)))), h("tbody", null, rows))),
  );
}
