// What an operator does to an alarm: each act with a name and a comment, each answered by the alarm after it.

import { post } from "./api.js";
import { field, h, select } from "./dom.js";
import { prefer, prefs } from "./prefs.js";
import { dialog } from "./shell.js";
import { look } from "./store.js";

const DURATIONS = [
  ["900", "15 minutes"], ["3600", "1 hour"], ["28800", "8 hours"], ["86400", "1 day"], ["604800", "1 week"],
];

/** Acts by their path: name, verb of the button, and whether they take a time. */
const ACTS = {
  ack: { title: "Acknowledge", verb: "Acknowledge" },
  shelve: { title: "Shelve for a while", verb: "Shelve", timed: true },
  unshelve: { title: "End the shelving", verb: "Unshelve" },
  suppress: { title: "Suppress until ended", verb: "Suppress" },
  unsuppress: { title: "End the suppression", verb: "Unsuppress" },
  "out-of-service": { title: "Take out of service", verb: "Take out of service" },
  return: { title: "Return to service", verb: "Return to service" },
  reset: { title: "Reset the latched alarm", verb: "Reset" },
};

/** The acts that fit the state of an alarm, the usual one first. */
export function actsFor(alarm) {
  switch (alarm.state) {
    case "shelved": return ["unshelve"];
    case "suppressed": return ["unsuppress"];
    case "out_of_service": return ["return"];
    case "unacknowledged":
    case "returned_unacknowledged": return ["ack", "shelve", "suppress", "out-of-service"];
    case "latched": return ["reset", "shelve"];
    default: return ["shelve", "suppress", "out-of-service"];
  }
}

/** A form for a name and a comment, called `label`; `send(body)` is called with them. Errors stay in the form. */
export function signedForm(verb, send, extra = null, { label = "Comment", isNeeded = false } = {}) {
  const author = h("input", { name: "author", required: true, maxlength: 200, autocomplete: "name", value: prefs.author });
  const comment = h("input", { name: "comment", required: isNeeded, maxlength: 2000, autocomplete: "off" });
  const said = h("p", { class: "said", role: "alert" });
  const button = h("button", { type: "submit", class: "primary" }, verb);
  const form = h("form", { class: "signed" }, field("Your name", author), field(label, comment), extra, button, said);
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    button.disabled = true;
    said.textContent = "";
    try {
      prefer({ author: author.value.trim() });
      await send({ author: author.value.trim(), comment: comment.value.trim() });
    } catch (error) {
      said.textContent = `Not done: ${error.message}`;
    } finally {
      button.disabled = false;
      look();
    }
  });
  return form;
}

/** Asks who and why, and does it. */
export async function act(name, alarm) {
  const { title, verb, timed } = ACTS[name];
  let seconds = "3600";
  const duration = timed && field("For", select(DURATIONS, seconds, (value) => (seconds = value)));
  const form = signedForm(verb, async (body) => {
    await post(`/alarms/${encodeURIComponent(alarm.id)}/${name}`, timed ? { ...body, for_s: Number(seconds) } : body);
    form.closest("dialog").close("done");
  }, duration);
  const cancel = h("button", { type: "button", onclick: (event) => event.target.closest("dialog").close() }, "Cancel");
  form.querySelector("button").before(cancel);
  await dialog(`${title}: ${alarm.machine}, ${alarm.component}`, h("p", { class: "soft" }, alarm.why), form);
}

/** Buttons of what fits the state. */
export function actButtons(alarm) {
  return h(
    "div",
    { class: "acts" },
    actsFor(alarm).map((name, i) =>
      h("button", { type: "button", class: i === 0 && name === "ack" ? "primary" : null, dataset: { act: name }, "aria-label": `${ACTS[name].verb} alarm ${alarm.id}`, onclick: () => act(name, alarm) }, ACTS[name].verb),
    ),
  );
}
