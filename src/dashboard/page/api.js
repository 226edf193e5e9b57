// Questions to the daemon. A token, where one is needed, is asked for once and kept for this tab only.

const ROOT = "/api/v1";
const KEY = "rotorwatch.token";

/** An answer that is no data: what the daemon says about it. */
export class Problem extends Error {
  constructor(status, body) {
    super(body?.detail ?? body?.title ?? `the daemon answered ${status}`);
    this.status = status;
    this.kind = body?.type?.split(":").at(-1) ?? "";
  }
}

let token = sessionStorage.getItem(KEY);
/** Asks the operator, and says why; set by the shell. Gives a token, or null if none is given. */
let askForToken = async () => null;
/** The question that is open, shared by all requests that wait for it. */
let asking = null;
/** Whether the operator gave none: until one is wanted nothing is sent, and nobody asked again and again. */
let isDeclined = false;

export function onTokenNeeded(ask) {
  askForToken = ask;
}

export function forgetToken() {
  token = null;
  sessionStorage.removeItem(KEY);
}

export const hasToken = () => token !== null;

/** Lets the operator be asked again. */
export function wantToken() {
  isDeclined = false;
}

function declined() {
  const problem = new Problem(401, { detail: "This daemon needs a token." });
  return Object.assign(problem, { remedy: { text: "Enter a token", prepare: wantToken } });
}

/** Why the daemon does not take a token; null: it does, or does not say. */
async function refusal(one) {
  // A header could not carry it.
  if (!/^[\x21-\x7e]+$/.test(one)) return new Problem(401, { detail: "no token has such characters" });
  try {
    const headers = { accept: "application/json", authorization: `Bearer ${one}` };
    return await notTaken(await fetch(`${ROOT}/alarms?limit=1`, { headers }));
  } catch {
    return null;
  }
}

/** What an answer says if it was given for want of a token, or of a right one. */
async function notTaken(response) {
  if (response.status !== 401 && response.status !== 429) return null;
  const problem = new Problem(response.status, await response.clone().json().catch(() => null));
  return response.status === 401 || problem.kind === "too-many-failures" ? problem : null;
}

/** Asks until a token is taken: tried once here, not by everything that waits for it. */
async function ask(why) {
  for (let reason = why; ; ) {
    const given = await askForToken(reason);
    if (!given) return null;
    const problem = await refusal(given);
    if (!problem) return given;
    reason = problem.message;
  }
}

/** Gets another token than `refused`, which the daemon did not take for the reason `why`. */
async function renewToken(refused, why) {
  // Somebody else was given another one meanwhile.
  if (token !== refused) return;
  asking ??= ask(refused === null ? null : why).finally(() => (asking = null));
  const given = await asking;
  // All who waited get the same answer.
  if (token !== refused) return;
  if (!given) {
    isDeclined = true;
    throw declined();
  }
  token = given;
  sessionStorage.setItem(KEY, given);
}

const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

/** Sends a request with the token; asks for one, and waits, as the daemon says. */
export async function send(path, options = {}) {
  for (let busy = 0; ; ) {
    // Without a token that may be right nothing is sent: each request would be refused.
    await asking?.catch(() => null);
    if (isDeclined) throw declined();
    const used = token;
    const headers = { accept: "application/json", ...options.headers };
    if (used !== null) headers.authorization = `Bearer ${used}`;
    const response = await fetch(`${ROOT}${path}`, { ...options, headers });
    const problem = await notTaken(response);
    if (problem) {
      await renewToken(used, problem.message);
      continue;
    }
    const isRead = !options.method || options.method === "GET";
    if (response.status === 503 && isRead && busy < 6 && !options.signal?.aborted) {
      const body = await response.json().catch(() => null);
      if (body?.type?.endsWith(":busy")) {
        busy += 1;
        await pause(150 * busy + 150 * Math.random());
        continue;
      }
      throw new Problem(503, body);
    }
    if (!response.ok) throw new Problem(response.status, await response.json().catch(() => null));
    return response;
  }
}

/** Spectra and the like: the daemon computes two at a time for everybody and tells others to wait. */
const HEAVY = /\/(spectrum|cwt|joint|orbit|trend)$/;
const HEAVY_AT_ONCE = 2;
const queue = [];
let heavy = 0;

/** Runs `work` when there is room for one more. */
async function inTurn(work) {
  if (heavy >= HEAVY_AT_ONCE) await new Promise((resolve) => queue.push(resolve));
  heavy += 1;
  try {
    return await work();
  } finally {
    heavy -= 1;
    queue.shift()?.();
  }
}

/** Reads JSON. Parameters that are null, undefined or empty are left out. */
export async function get(path, parameters = {}, signal = undefined) {
  const query = new URLSearchParams();
  for (const [name, value] of Object.entries(parameters)) {
    if (value !== null && value !== undefined && value !== "") query.set(name, value);
  }
  const text = query.toString();
  const read = async () => {
    signal?.throwIfAborted();
    return (await send(text ? `${path}?${text}` : path, { signal })).json();
  };
  return HEAVY.test(path) ? inTurn(read) : read();
}

export async function post(path, body) {
  const headers = { "content-type": "application/json" };
  return (await send(path, body === null ? { method: "POST" } : { method: "POST", headers, body: JSON.stringify(body) })).json();
}

/** Takes something away; what is said of it goes into the address. */
export async function remove(path, parameters) {
  await send(`${path}?${new URLSearchParams(parameters)}`, { method: "DELETE" });
}

/** Fetches a file and hands it to the browser. A link could not carry the token. */
export async function download(path, name) {
  const response = await send(path, { headers: { accept: "*/*" } });
  const address = URL.createObjectURL(await response.blob());
  const link = document.createElement("a");
  link.href = address;
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(address), 10_000);
}

export const machinePath = (id) => `/machines/${encodeURIComponent(id)}`;
export const channelPath = (id, name) => `${machinePath(id)}/channels/${encodeURIComponent(name)}`;
