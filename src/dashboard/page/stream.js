// The stream of events, read by fetch (an EventSource cannot carry a token). Comes again by itself, from its place.

import { send } from "./api.js";

/** The daemon says something every 15 s. */
const SILENCE_MS = 40_000;
const FIRST_PAUSE_MS = 500;
const LONGEST_PAUSE_MS = 15_000;

/** Splits a text of server-sent events; gives what is not ended yet. */
export function parse(text, take) {
  const blocks = text.split(/\r?\n\r?\n/);
  const rest = blocks.pop();
  for (const block of blocks) {
    const event = { name: "message", data: "", id: null };
    for (const line of block.split(/\r?\n/)) {
      const colon = line.indexOf(":");
      if (colon === 0) continue;
      const key = colon < 0 ? line : line.slice(0, colon);
      const value = colon < 0 ? "" : line.slice(colon + 1).replace(/^ /, "");
      if (key === "event") event.name = value;
      else if (key === "data") event.data += event.data ? `\n${value}` : value;
      else if (key === "id") event.id = value;
    }
    take(event);
  }
  return rest;
}

/** Follows what happens until the answer is called. `onState` hears `live` or `lost`. */
export function follow(onEvent, onState) {
  let place = "";
  let pauseMs = FIRST_PAUSE_MS;
  let isEnded = false;
  let abort = new AbortController();

  async function once() {
    abort = new AbortController();
    let silence = setTimeout(() => abort.abort(), SILENCE_MS);
    const headers = { accept: "text/event-stream" };
    if (place) headers["last-event-id"] = place;
    try {
      const response = await send("/events", { headers, signal: abort.signal, cache: "no-store" });
      onState("live");
      pauseMs = FIRST_PAUSE_MS;
      const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
      for (let rest = ""; ; ) {
        const { value, done } = await reader.read();
        if (done) return;
        clearTimeout(silence);
        silence = setTimeout(() => abort.abort(), SILENCE_MS);
        rest = parse(rest + value, (event) => {
          if (event.id) place = event.id;
          if (event.data) onEvent(event.name, JSON.parse(event.data));
        });
      }
    } finally {
      clearTimeout(silence);
    }
  }

  async function run() {
    while (!isEnded) {
      let reason;
      try {
        await once();
      } catch (error) {
        reason = error;
      }
      if (isEnded) return;
      onState("lost", reason);
      await new Promise((resolve) => setTimeout(resolve, pauseMs));
      pauseMs = Math.min(2 * pauseMs, LONGEST_PAUSE_MS);
    }
  }

  run();
  return () => {
    isEnded = true;
    abort.abort();
  };
}
