// The drivetrain as a picture, from the machine's description: shafts, gears, bearings, motors, sensors, by state.

import { s } from "./dom.js";

const ROW = 128;
const LEFT = 150;
const PITCH = 120;
const TOP = 74;

/** Shafts in the order of the train, joined by meshes; a shaft without one stands alone. */
function ordered(machine) {
  const ids = machine.shafts.map((shaft) => shaft.id);
  const hasMotor = (id) => machine.motors.some((motor) => motor.shaft === id);
  const isDriven = (id) => machine.gears.some((gear) => gear.driven.shaft === id);
  const queue = ids.filter((id) => hasMotor(id) || !isDriven(id));
  const found = [];
  for (const id of [...queue, ...ids]) walk(id);
  function walk(id) {
    if (found.includes(id)) return;
    found.push(id);
    for (const gear of machine.gears) if (gear.driving.shaft === id) walk(gear.driven.shaft);
  }
  return found;
}

/** What sits on each shaft, from left to right. */
function layout(machine) {
  const shafts = ordered(machine);
  const seats = new Map(shafts.map((id) => [id, []]));
  const meshColumn = new Map();
  let column = 0;
  // Meshes first: both wheels of one stand in one column.
  for (const gear of machine.gears) {
    meshColumn.set(gear.id, column + 1);
    column += 2;
  }
  for (const gear of machine.gears) {
    for (const side of ["driving", "driven"]) {
      seats.get(gear[side].shaft)?.push({ what: "gear", id: gear.id, side, teeth: gear[side].teeth, at: meshColumn.get(gear.id) });
    }
  }
  let last = Math.max(column, 1);
  for (const id of shafts) {
    const bearings = machine.bearings.filter((bearing) => bearing.shaft === id);
    const taken = new Set(seats.get(id).map((seat) => seat.at));
    let at = 0;
    for (const bearing of bearings) {
      while (taken.has(at)) at += 1;
      taken.add(at);
      seats.get(id).push({ what: "bearing", id: bearing.id, at });
      at += 1;
    }
    if (machine.sensors.some((sensor) => sensor.at?.kind === "shaft" && sensor.at.id === id)) {
      while (taken.has(at)) at += 1;
      seats.get(id).push({ what: "plane", id, at });
      taken.add(at);
    }
    last = Math.max(last, ...taken);
  }
  return { shafts, seats, last };
}

/** A part that can be chosen by pointer and key. */
function part(kind, id, state, chosen, onChoose, ...shapes) {
  const isChosen = chosen?.kind === kind && chosen?.id === id;
  const act = () => onChoose(kind, id);
  return s(
    "g",
    {
      class: `part ${state}${isChosen ? " chosen" : ""}`,
      tabindex: 0,
      role: "button",
      "aria-pressed": String(isChosen),
      "aria-label": `${kind} ${id}: ${state}`,
      "data-part": `${kind}/${id}`,
      onclick: act,
      onkeydown: (event) => {
        if (event.key !== "Enter" && event.key !== " ") return;
        event.preventDefault();
        act();
      },
    },
    shapes,
  );
}

function wheel(x, y, radius, teeth) {
  const shown = Math.max(8, Math.min(36, Math.round(teeth / 2)));
  const points = [];
  for (let i = 0; i < shown * 4; i += 1) {
    const angle = ((i + 0.5) / (shown * 4)) * 2 * Math.PI;
    const r = i % 4 < 2 ? radius : radius - 4;
    points.push(`${(x + r * Math.cos(angle)).toFixed(1)},${(y + r * Math.sin(angle)).toFixed(1)}`);
  }
  return [s("polygon", { class: "body", points: points.join(" ") }), s("circle", { class: "hub", cx: x, cy: y, r: 7 })];
}

function bearing(x, y) {
  const balls = [0, 45, 90, 135, 180, 225, 270, 315].map((deg) => {
    const a = (deg * Math.PI) / 180;
    return s("circle", { class: "ball", cx: x + 16 * Math.cos(a), cy: y + 16 * Math.sin(a), r: 4 });
  });
  return [
    s("circle", { class: "body", cx: x, cy: y, r: 24 }),
    s("circle", { class: "ring", cx: x, cy: y, r: 10 }),
    balls,
    s("path", { class: "foot", d: `M${x - 22} ${y + 34}h44M${x - 13} ${y + 34}L${x - 8} ${y + 23}M${x + 13} ${y + 34}L${x + 8} ${y + 23}` }),
  ];
}

/** Sensors at a place, as dots with their channel's name on request. */
function sensors(machine, kind, id, x, y, quality) {
  const here = machine.sensors.filter((sensor) => sensor.at?.kind === kind && sensor.at.id === id);
  return here.map((sensor, i) => {
    const cx = x - (here.length - 1) * 8 + i * 16;
    const state = quality.get(sensor.channel) ?? "healthy";
    return s(
      "g",
      { class: `sensor ${state}` },
      s("title", null, `${sensor.channel}: ${sensor.kind}${sensor.axis_deg === null ? "" : `, ${sensor.axis_deg}°`}`),
      s("line", { x1: cx, x2: cx, y1: y + 5, y2: y + 12 }),
      s("rect", { x: cx - 5, y: y - 5, width: 10, height: 10, rx: 2 }),
    );
  });
}

const text = (x, y, name, value, anchor = "middle") => s("text", { x, y, class: name, "text-anchor": anchor }, value);

/** The picture. `states`: of components by `kind/id`; `onChoose(kind, id)`. */
export function drivetrain(machine, states, chosen, onChoose) {
  const { shafts, seats, last } = layout(machine);
  const width = LEFT + (last + 1) * PITCH + 20;
  const height = TOP + (shafts.length - 1) * ROW + 66;
  const state = (kind, id) => states.get(`${kind}/${id}`) ?? "undetermined";
  const quality = new Map([...states].filter(([key]) => key.startsWith("sensor/")).map(([key, value]) => [key.slice(7), value]));
  const x = (at) => LEFT + (at + 0.5) * PITCH;
  const y = (id) => TOP + shafts.indexOf(id) * ROW;
  const drawn = [];

  for (const gear of machine.gears) {
    const at = seats.get(gear.driving.shaft)?.find((seat) => seat.id === gear.id && seat.what === "gear")?.at ?? 0;
    const [y0, y1] = [y(gear.driving.shaft), y(gear.driven.shaft)];
    drawn.push(s("line", { class: "mesh", x1: x(at), x2: x(at), y1: Math.min(y0, y1), y2: Math.max(y0, y1) }));
  }
  for (const id of shafts) {
    const own = machine.shafts.find((one) => one.id === id);
    const motor = machine.motors.some((one) => one.shaft === id) || (!machine.motors.length && id === "motor");
    const right = x(Math.max(1, ...seats.get(id).map((seat) => seat.at))) + 46;
    drawn.push(
      part("shaft", id, state("shaft", id), chosen, onChoose, [
        s("rect", { class: "body", x: LEFT - 30, y: y(id) - 6, width: right - LEFT + 30, height: 12, rx: 3 }),
        motor && s("rect", { class: "body", x: LEFT - 62, y: y(id) - 22, width: 40, height: 44, rx: 5 }),
        motor && text(LEFT - 42, y(id) + 5, "sign", "M"),
        s("rect", { class: "reach", x: 4, y: y(id) - 24, width: LEFT - 40, height: 44 }),
        text(10, y(id) - 26, "name", id, "start"),
        own?.nominal_speed_hz || own?.ratio_to_first
          ? text(10, y(id) - 11, "fact", `${((own.ratio_to_first ?? 0) * (machine.frequencies?.shaft_speed_hz ?? 0) || own.nominal_speed_hz || 0).toFixed(2)} Hz`, "start")
          : null,
      ]),
    );
  }
  for (const id of shafts) {
    for (const seat of seats.get(id)) {
      const [cx, cy] = [x(seat.at), y(id)];
      if (seat.what === "gear") {
        drawn.push(
          part("gear", seat.id, state("gear", seat.id), chosen, onChoose, [
            wheel(cx, cy, 34, seat.teeth),
            text(cx, cy - 40, "fact", `${seat.teeth} teeth`),
            seat.side === "driven" && text(cx, cy + 52, "name", seat.id),
          ]),
        );
        if (seat.side === "driven") drawn.push(sensors(machine, "gear", seat.id, cx, cy - 58, quality));
      } else if (seat.what === "bearing") {
        drawn.push(part("bearing", seat.id, state("bearing", seat.id), chosen, onChoose, [bearing(cx, cy), text(cx, cy + 52, "name", seat.id)]));
        drawn.push(sensors(machine, "bearing", seat.id, cx, cy - 38, quality));
      } else {
        drawn.push(s("line", { class: "plane", x1: cx, x2: cx, y1: cy - 20, y2: cy + 20 }), sensors(machine, "shaft", id, cx, cy - 32, quality));
      }
    }
  }
  return s(
    "svg",
    { class: "drivetrain", viewBox: `0 0 ${width} ${height}`, role: "group", "aria-label": `Drivetrain of ${machine.name || machine.id}` },
    drawn,
  );
}
