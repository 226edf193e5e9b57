// What people found of a verdict: said in the panel of its component, kept by the daemon, never learned from by itself.

import { get, machinePath, post } from "./api.js";
import { signedForm } from "./acts.js";
import { empty, failed, field, fill, h, loading, select } from "./dom.js";
import { fault, time, words } from "./format.js";
import { dialog } from "./shell.js";

const OUTCOMES = [["confirmed", "Right"], ["wrong", "Wrong"], ["other_cause", "Another cause"]];
const FAULTS = {
  bearing: ["inner_race", "outer_race", "rolling_element", "cage"],
  shaft: ["bow", "unbalance", "misalignment", "looseness"],
  gear: ["tooth_damage", "distributed_wear"],
};
/** Entries shown, of which those of the component are picked. */
const PAGE = 200;

async function say(path, component, outcome, name, done) {
  let found = "";
  const causes = Object.values(FAULTS).flat().map((one) => [one, words(one)]);
  const cause = outcome === "other_cause" ? field("Cause found", select([["", "as the comment says"], ...causes], found, (value) => (found = value))) : null;
  const form = signedForm("Send", async ({ author, comment }) => {
    const body = { author, outcome, kind: component.kind, component: component.id, note: comment };
    await post(path, found ? { ...body, fault: found } : body);
    form.closest("dialog").close("done");
    done();
  }, cause);
  form.querySelector("button").before(h("button", { type: "button", onclick: (event) => event.target.closest("dialog").close() }, "Cancel"));
  const verdict = fault(component.fault, component.state) || component.state;
  await dialog(`${name}: ${component.kind} ${component.id}`, h("p", { class: "soft" }, `The verdict is ${verdict}. What you say is kept with it for people to read; the daemon does not learn from it by itself.`), form);
}

const entry = (one) =>
  h("li", null, h("time", { class: "soft" }, time(one.at)), ` ${one.author}: ${words(one.outcome)}${one.fault ? `, ${words(one.fault)}` : ""}${one.note ? `: ${one.note}` : ""}`, h("span", { class: "soft" }, ` (verdict: ${fault(one.verdict.fault, one.verdict.state) || one.verdict.state})`));

/** Buttons for what was found of the verdict on a component, and what was said before. */
export function feedback(machine, component) {
  const path = `${machinePath(machine)}/diagnosis/feedback`;
  const said = h("div");
  const details = h("details", { class: "feedback-list", ontoggle: () => details.open && list() }, h("summary", null, "What people found"), said);

  async function list() {
    fill(said, loading("feedback"));
    try {
      const page = await get(path, { limit: PAGE });
      const mine = page.items.filter((one) => one.kind === component.kind && one.component === component.id);
      fill(said, mine.length > 0 ? h("ul", { class: "story" }, mine.map(entry)) : empty("Nobody has said anything of a verdict on it yet."));
    } catch (error) {
      fill(said, failed(error, list));
    }
  }

  const done = () => {
    if (details.open) list();
    else details.open = true;
  };
  const buttons = OUTCOMES.map(([outcome, name]) => h("button", { type: "button", dataset: { feedback: outcome }, onclick: () => say(path, component, outcome, name, done) }, name));
  return h("div", { class: "feedback" }, h("div", { class: "acts", role: "group", "aria-label": "Was this verdict right?" }, h("span", { class: "soft" }, "Was this verdict right?"), buttons), details);
}
