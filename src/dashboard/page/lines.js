// Lines a construction may show, and those found in a spectrum: what the cursors stand on.

/** Relative distance within which a line is looked for beside its place: slip of a bearing, not of another line. */
const SEARCH = 0.012;
/** Height over the surroundings from which a bin counts as a line: noise reaches 11 dB in 80 bins once in thousands. */
const MATCHED_DB = 15;
/** Bins on either side of a line in which the floor beside it is read. */
const FLOOR_BINS = 40;

const LABELS = { bpfo: "BPFO", bpfi: "BPFI", ftf: "FTF", bsf2: "2·BSF", bsf: "2·BSF" };
const OF_FAULT = { outer_race: "BPFO", inner_race: "BPFI", rolling_element: "2·BSF", cage: "FTF" };

/** Rows of a machine's table of frequencies. */
export function table(machine) {
  const t = machine.frequencies;
  if (!t) return [];
  return t.label.map((label, i) => ({
    kind: t.owner_kind[i],
    owner: t.owner[i],
    label,
    hz: t.frequency_hz[i],
    order: t.order[i],
  }));
}

/** Speed of the shaft of a component, Hz; null: not known. */
export function speedOf(machine, kind, id) {
  const shaft =
    kind === "shaft"
      ? id
      : kind === "bearing"
        ? machine.bearings.find((b) => b.id === id)?.shaft
        : kind === "gear"
          ? machine.gears.find((g) => g.id === id)?.driving.shaft
          : machine.shafts[0]?.id;
  const ratio = machine.shafts.find((one) => one.id === shaft)?.ratio_to_first;
  const first = machine.frequencies?.shaft_speed_hz;
  return ratio && first ? ratio * first : null;
}

const lineOf = (machine, owner, label) => table(machine).find((row) => row.owner === owner && row.label === label)?.hz ?? null;

/** Label of a bearing's line that an indicator is about. */
export function lineOfIndicator(indicator) {
  const name = /(?:^|_)(bpfo|bpfi|ftf|bsf2|bsf)(?:_|$)/.exec(indicator)?.[1];
  return name ? LABELS[name] : null;
}

const times = (k, label) => (k === 1 ? label : `${k}·${label}`);

/** Harmonics of a line with the side bands it carries: `{label, hz, kind}`. */
function family(label, hz, harmonics, spacing, spacingName, bands) {
  const found = [];
  for (let k = 1; k <= harmonics; k += 1) {
    found.push({ label: times(k, label), hz: k * hz, kind: "line" });
    if (!spacing || !(spacing < hz)) continue;
    for (let m = 1; m <= bands; m += 1) {
      found.push({ label: `−${m}${spacingName}`, hz: k * hz - m * spacing, kind: "band", beside: k * hz });
      found.push({ label: `+${m}${spacingName}`, hz: k * hz + m * spacing, kind: "band", beside: k * hz });
    }
  }
  return found;
}

/**
 * The lines of a component for a spectrum: `harmonics` of each, `bands` side bands on either side. `only`: the label of the one line.
 */
export function linesOf(machine, kind, id, { harmonics = 3, bands = 1, only = null } = {}) {
  const speed = speedOf(machine, kind, id);
  if (kind === "shaft") {
    return speed ? family("1×", speed, harmonics, null, "", 0).map((one, k) => ({ ...one, label: `${k + 1}×` })) : [];
  }
  if (kind === "bearing") {
    const labels = only ? [only] : ["BPFO", "BPFI", "2·BSF", "FTF"];
    const cage = lineOf(machine, id, "FTF");
    return labels.flatMap((label) => {
      const hz = lineOf(machine, id, label);
      if (!hz) return [];
      // What turns into and out of the load modulates: the inner ring by the shaft, an element by the cage.
      const [spacing, name] = label === "BPFI" ? [speed, "×"] : label === "2·BSF" ? [cage, " FTF"] : [null, ""];
      return family(label, hz, harmonics, spacing, name, bands).map((one) => ({ ...one, slips: true }));
    });
  }
  if (kind === "gear") {
    const mesh = lineOf(machine, id, "GMF");
    return mesh ? family("GMF", mesh, harmonics, speed, "×", bands) : [];
  }
  return [];
}

export const lineOfFault = (fault) => OF_FAULT[fault] ?? null;

/** Place of the first value at or above `wanted` in rising `values`. */
function placeOf(values, wanted) {
  let low = 0;
  let high = values.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (values[middle] < wanted) low = middle + 1;
    else high = middle;
  }
  return low;
}

function medianAround(value, from, to) {
  const beside = value.slice(Math.max(0, from), to).filter((v) => v !== null).sort((a, b) => a - b);
  return beside.length ? beside[beside.length >> 1] : null;
}

/**
 * Looks for lines in a spectrum (`frequency_hz`, `value`, `resolution_hz`): the highest bin near the place, its value and how far it
 * stands over the median beside it, dB. A bearing slips: its lines are looked for around their place, their side bands beside what was found. A line is `matched` if it stands 15 dB out.
 */
export function match(spectrum, lines) {
  const { frequency_hz: hz, value, kind } = spectrum;
  if (hz.length === 0) return [];
  const width = spectrum.resolution_hz ?? 0;
  const factor = kind === "psd" ? 10 : 20;
  const moved = new Map();
  return lines
    .filter((line) => line.hz > 0 && line.hz <= hz.at(-1) && line.hz >= hz[0])
    .map((line) => {
      const place = line.hz + (moved.get(line.beside) ?? 0);
      const reach = Math.max(1.5 * width, line.slips && line.kind === "line" ? SEARCH * line.hz : 0);
      const [from, to] = [placeOf(hz, place - reach), placeOf(hz, place + reach)];
      let best = -1;
      for (let i = from; i < to; i += 1) if (best < 0 || value[i] > value[best]) best = i;
      if (best < 0) return { ...line, found: null, value: null, over: null, matched: false };
      const floor = medianAround(value, best - FLOOR_BINS, best + FLOOR_BINS);
      const over = floor > 0 && value[best] > 0 ? factor * Math.log10(value[best] / floor) : null;
      const isOut = over !== null && over >= MATCHED_DB;
      if (isOut && line.kind === "line") moved.set(line.hz, hz[best] - line.hz);
      return { ...line, found: hz[best], value: value[best], over, matched: isOut };
    });
}

/** Highest peaks of a spectrum, `count` of them, each the largest within its neighbourhood. */
export function peaks(spectrum, count, from = 0, to = Infinity) {
  const { frequency_hz: hz, value } = spectrum;
  const found = [];
  for (let i = 2; i < value.length - 2; i += 1) {
    if (hz[i] < from || hz[i] > to) continue;
    if (value[i] > value[i - 1] && value[i] >= value[i + 1] && value[i] > value[i - 2] && value[i] >= value[i + 2]) {
      found.push({ hz: hz[i], value: value[i] });
    }
  }
  return found.sort((a, b) => b.value - a.value).slice(0, count).sort((a, b) => a.hz - b.hz);
}
