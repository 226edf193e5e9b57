// The path of a shaft as its pair of sensors sees it.

import { axes, canvasIn } from "./canvas.js";
import { hertz, number, shownIn } from "./format.js";
import { h } from "./dom.js";
import { colour, extent, ticks } from "./scale.js";

const MARGIN = { left: 62, top: 10, right: 12, bottom: 44 };

/** Draws an orbit (`GET /machines/{id}/orbit`) with its marks and the ellipse at 1×. */
export function orbitPlot(host, orbit) {
  let shown = orbit;
  const facts = h("div", { class: "facts" });

  function draw(ctx, width, height) {
    const { unit, factor } = shownIn(shown.unit);
    const field = { left: MARGIN.left, top: MARGIN.top, right: width - MARGIN.right, bottom: height - MARGIN.bottom };
    const reach = Math.max(...(extent(shown.x.concat(shown.y)) ?? [-1, 1]).map(Math.abs)) * factor * 1.1 || 1;
    const x = (v) => field.left + ((v + reach) / (2 * reach)) * (field.right - field.left);
    const y = (v) => field.bottom - ((v + reach) / (2 * reach)) * (field.bottom - field.top);
    const values = ticks(-reach, reach, 5);
    ctx.strokeStyle = colour("grid");
    for (const value of values) {
      ctx.strokeRect(x(value), field.top, 0, field.bottom - field.top);
      ctx.strokeRect(field.left, y(value), field.right - field.left, 0);
    }
    axes(
      ctx,
      field,
      { ticks: values, at: x, label: `${shown.x_channel} (${unit})` },
      { ticks: values, at: y, label: `${shown.y_channel} (${unit})` },
    );
    path(ctx, x, y, factor);
    const first = shown.ellipses.find((ellipse) => ellipse.order === 1);
    if (first) drawEllipse(ctx, first, x, y, factor);
  }

  function path(ctx, x, y, factor) {
    ctx.strokeStyle = colour("line-1");
    ctx.lineWidth = 1.25;
    ctx.beginPath();
    shown.x.forEach((value, i) => ctx.lineTo(x(value * factor), y(shown.y[i] * factor)));
    ctx.globalAlpha = 0.6;
    ctx.stroke();
    ctx.globalAlpha = 1;
    // A blank before and a dot at the mark, as on an oscilloscope.
    for (const at of shown.marks) {
      if (shown.x[at] === undefined) continue;
      ctx.fillStyle = colour("damaged");
      ctx.beginPath();
      ctx.arc(x(shown.x[at] * factor), y(shown.y[at] * factor), 4, 0, 2 * Math.PI);
      ctx.fill();
    }
  }

  function drawEllipse(ctx, ellipse, x, y, factor) {
    const [a, b] = [ellipse.major * factor, Math.abs(ellipse.minor) * factor];
    const tilt = ((ellipse.inclination_deg ?? 0) * Math.PI) / 180;
    ctx.strokeStyle = colour("matched");
    ctx.setLineDash([5, 4]);
    ctx.lineWidth = 1.5;
    ctx.beginPath();
    for (let i = 0; i <= 90; i += 1) {
      const t = (i / 45) * Math.PI;
      const [u, v] = [a * Math.cos(t), b * Math.sin(t)];
      ctx.lineTo(x(u * Math.cos(tilt) - v * Math.sin(tilt)), y(u * Math.sin(tilt) + v * Math.cos(tilt)));
    }
    ctx.stroke();
    ctx.setLineDash([]);
  }

  function sense(ellipse) {
    if (!shown.rotation) return ellipse.minor < 0 ? "clockwise" : "counter-clockwise";
    return ellipse.minor < 0 === (shown.rotation === "cw") ? "forward" : "backward";
  }

  function tell() {
    const { unit, factor } = shownIn(shown.unit);
    const from = { mark: "red dots: mark of the tacho", tacho: "by the tacho", speed: "by the speed, no mark" }[shown.angle_from];
    facts.replaceChildren(
      h("p", { class: "readout" }, `${shown.revolutions} revolutions of ${shown.shaft} at ${hertz(shown.shaft_speed_hz)}; ${from}; dashed: 1× ellipse`),
      h("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": "Ellipses" }, h(
        "table",
        { class: "small" },
        h("thead", null, h("tr", null, ["Order", `Long half axis (${unit})`, `Short half axis (${unit})`, "Sense"].map((t) => h("th", { scope: "col" }, t)))),
        h("tbody", null, shown.ellipses.map((e) =>
          h("tr", null, [`${e.order}×`, number(e.major * factor), number(Math.abs(e.minor) * factor), sense(e)].map((t) => h("td", null, t))))),
      )),
    );
  }

  const made = canvasIn(host, `Orbit of ${orbit.x_channel} and ${orbit.y_channel}`, (width) => Math.min(width, 420), draw);
  made.canvas.classList.add("square");
  host.append(facts);
  tell();
  return {
    update(next) {
      shown = next;
      made.paint();
      tell();
    },
    end: made.end,
  };
}
