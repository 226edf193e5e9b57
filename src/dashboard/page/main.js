// Which view stands at which address, and the shell around them.

import { h, failed } from "./dom.js";
import { onPrefer } from "./prefs.js";
import { buildShell, showNav } from "./shell.js";
import { start, state, watch } from "./store.js";
import { openAlarms } from "./alarms.js";
import { openCaptures } from "./captures.js";
import { openDemo } from "./demo.js";
import { openFleet } from "./fleet.js";
import { openMachine } from "./machine.js";
import { openSignals } from "./signals.js";

const VIEWS = { "": openFleet, machine: openMachine, signals: openSignals, alarms: openAlarms, captures: openCaptures, simulation: openDemo };
const TITLES = { "": "Fleet", machine: "Machine", signals: "Signals", alarms: "Alarms", captures: "Captures", simulation: "Simulation" };

/** The view that is open: `{update(state)?, close()?}`. */
let open = null;

/** Parts of the address behind `#/`, and its parameters. */
function address() {
  const [path, query] = location.hash.replace(/^#\/?/, "").split("?");
  const decode = (part) => {
    try {
      return decodeURIComponent(part);
    } catch {
      return part;
    }
  };
  return { parts: path.split("/").map(decode), query: new URLSearchParams(query ?? "") };
}

function show({ focus = false } = {}) {
  const { parts, query } = address();
  const view = VIEWS[parts[0]];
  const main = document.getElementById("view");
  open?.close?.();
  open = null;
  main.replaceChildren();
  main.dataset.view = parts[0] || "fleet";
  document.title = `${[...parts.slice(1), TITLES[parts[0]] ?? "not found"].filter(Boolean).slice(0, 2).join(" · ")} – rotorwatch`;
  if (!view) {
    main.append(h("p", { class: "note" }, "Nothing is at this address. ", h("a", { href: "#/" }, "To the fleet")));
    return;
  }
  try {
    open = view(main, { parts, query, state });
    open.update?.(state);
  } catch (error) {
    main.append(failed(error, () => show()));
    throw error;
  }
  showNav(parts[0], state);
  if (focus) main.focus({ preventScroll: true });
}

buildShell();
window.addEventListener("hashchange", () => {
  // The skip link is no address of a view.
  if (location.hash.startsWith("#/") || location.hash === "") {
    show({ focus: true });
    window.scrollTo(0, 0);
  }
});
onPrefer(() => open?.update?.(state));
watch(() => {
  showNav(address().parts[0], state);
  open?.update?.(state);
});
show();
start();
