// Maintenance of a machine: that it is maintained, by whom, why and until when; begun and ended by an operator.

import { machinePath, post, remove } from "./api.js";
import { signedForm } from "./acts.js";
import { field, h, select } from "./dom.js";
import { time } from "./format.js";
import { dialog } from "./shell.js";

const DURATIONS = [
  ["3600", "1 hour"], ["14400", "4 hours"], ["28800", "8 hours"], ["86400", "1 day"], ["604800", "1 week"],
];

/** That a machine is maintained, in a few words; `null`: it is not. */
export function maintenancePill(maintenance) {
  if (!maintenance) return null;
  const title = `${maintenance.author}: ${maintenance.reason}`;
  return h("span", { class: "pill maintained", title }, `maintenance until ${time(maintenance.until, { seconds: false })}`);
}

/** The same as a sentence. */
export function maintenanceNote(maintenance) {
  if (!maintenance) return null;
  const { author, reason, until } = maintenance;
  return h("p", { class: "note maintained" }, `Maintenance until ${time(until)} by ${author}: ${reason}. Its alarms are out of service until then.`);
}

async function ask(title, verb, what, send, extra) {
  const form = signedForm(verb, async (body) => {
    await send(body);
    form.closest("dialog").close("done");
  }, extra, { label: what, isNeeded: extra !== null });
  form.querySelector("button").before(h("button", { type: "button", onclick: (event) => event.target.closest("dialog").close() }, "Cancel"));
  await dialog(title, form);
}

/** The button that begins the maintenance of a machine, or ends it. */
export function maintenanceButton(id, maintenance) {
  const path = `${machinePath(id)}/maintenance`;
  const end = () => ask(`End the maintenance of ${id}`, "End maintenance", "Comment", (body) => remove(path, body), null);
  const begin = () => {
    let seconds = "14400";
    const duration = field("For", select(DURATIONS, seconds, (value) => (seconds = value)));
    return ask(`Maintenance of ${id}`, "Begin maintenance", "Reason", ({ author, comment }) => post(path, { author, reason: comment, for_s: Number(seconds) }), duration);
  };
  return h("button", { type: "button", dataset: { act: "maintenance" }, onclick: maintenance ? end : begin }, maintenance ? "End maintenance" : "Maintenance");
}
