// Heights as colours over two axes: scalograms and waterfalls.

import { axes, canvasIn } from "./canvas.js";
import { h } from "./dom.js";
import { number } from "./format.js";
import { PALETTE, colour, logTicks, ticks } from "./scale.js";

const MARGIN = { left: 66, top: 10, right: 74, bottom: 44 };
/** Decades shown below the largest value. */
const DECADES = 3;

/** Colour of a value between `low` and `high`, by its logarithm if `log`. */
function scaleOf(spec) {
  let high = 0;
  for (const row of spec.rows) for (const value of row) if (value !== null && value > high) high = value;
  if (!(high > 0)) high = 1;
  const low = spec.log ? high * 10 ** -DECADES : 0;
  const part = spec.log
    ? (v) => (v > 0 ? Math.log10(v / low) / DECADES : 0)
    : (v) => v / high;
  return { low, high, part };
}

/** The picture, a pixel a value; what is not valid is left out. */
function picture(spec, scale) {
  const rows = spec.rows.length;
  const columns = Math.max(...spec.rows.map((row) => row.length), 1);
  const image = new ImageData(columns, rows);
  for (let r = 0; r < rows; r += 1) {
    // The lowest row stands at the bottom.
    const y = rows - 1 - r;
    const [from, to] = spec.valid?.[r] ?? [0, columns];
    for (let c = 0; c < columns; c += 1) {
      const value = spec.rows[r][c];
      if (value === null || value === undefined || c < from || c >= to) continue;
      const shade = Math.max(0, Math.min(255, Math.round(255 * scale.part(value))));
      const at = 4 * (y * columns + c);
      image.data.set([PALETTE[3 * shade], PALETTE[3 * shade + 1], PALETTE[3 * shade + 2], 255], at);
    }
  }
  const small = new OffscreenCanvas(columns, rows);
  small.getContext("2d").putImageData(image, 0, 0);
  return small;
}

/**
 * A map in `host`. `spec`: `title`; `rows` from low to high y, each a list of values; `x` and `y`: `{from, to, label, log, text}`;
 * `unit` of values; `log` colours; `valid`: columns of each row that hold; `marks`: `{y, label}` lines across, `{x, label}` lines up.
 */
export function heatMap(host, spec) {
  let shown = spec;
  const readout = h("p", { class: "readout", "aria-hidden": "true" }, shown.hint ?? "");
  let field = null;

  const place = (axis, from, to) => {
    const { log, from: low, to: high } = axis;
    const part = log ? (v) => Math.log(v / low) / Math.log(high / low) : (v) => (v - low) / (high - low || 1);
    return (v) => from + part(v) * (to - from);
  };

  function draw(ctx, width, height) {
    field = { left: MARGIN.left, top: MARGIN.top, right: width - MARGIN.right, bottom: height - MARGIN.bottom };
    const { left, top, right, bottom } = field;
    ctx.fillStyle = colour("hollow");
    ctx.fillRect(left, top, right - left, bottom - top);
    const scale = scaleOf(shown);
    if (shown.rows.length > 0) {
      ctx.imageSmoothingEnabled = shown.smooth === true;
      ctx.drawImage(picture(shown, scale), left, top, right - left, bottom - top);
    }
    const x = place(shown.x, left, right);
    const y = place(shown.y, bottom, top);
    for (const mark of shown.marks ?? []) drawMark(ctx, mark, x, y);
    axes(
      ctx,
      field,
      { ...shown.x, at: x, ticks: shown.x.ticks ?? ticks(shown.x.from, shown.x.to, Math.max(3, (right - left) / 90)) },
      { ...shown.y, at: y, ticks: shown.y.log ? logTicks(shown.y.from, shown.y.to) : ticks(shown.y.from, shown.y.to, 6) },
    );
    drawBar(ctx, scale, width);
  }

  function drawMark(ctx, mark, x, y) {
    const { left, top, right, bottom } = field;
    ctx.strokeStyle = "#ffffffcc";
    ctx.lineWidth = 1;
    ctx.setLineDash([4, 4]);
    ctx.beginPath();
    const at = mark.y === undefined ? x(mark.x) : y(mark.y);
    if (mark.y === undefined ? at < left || at > right : at < top || at > bottom) return;
    if (mark.y === undefined) {
      ctx.moveTo(at, top);
      ctx.lineTo(at, bottom);
    } else {
      ctx.moveTo(left, at);
      ctx.lineTo(right, at);
    }
    ctx.stroke();
    ctx.setLineDash([]);
    const w = ctx.measureText(mark.label).width;
    const [tx, ty] = mark.y === undefined ? [Math.min(at + 4, right - w - 6), top + 4] : [left + 6, at - 17];
    ctx.fillStyle = "#000000a0";
    ctx.fillRect(tx - 3, ty, w + 6, 15);
    ctx.fillStyle = "#ffffff";
    ctx.textAlign = "left";
    ctx.textBaseline = "top";
    ctx.fillText(mark.label, tx, ty + 1);
  }

  function drawBar(ctx, scale, width) {
    const { top, bottom } = field;
    const left = width - MARGIN.right + 14;
    for (let y = top; y < bottom; y += 1) {
      const shade = Math.round(255 * (1 - (y - top) / (bottom - top)));
      ctx.fillStyle = `rgb(${PALETTE[3 * shade]} ${PALETTE[3 * shade + 1]} ${PALETTE[3 * shade + 2]})`;
      // Down to the end: rows that end between two pixels of the screen would leave stripes.
      ctx.fillRect(left, y, 12, bottom - y);
    }
    ctx.fillStyle = colour("soft");
    ctx.textAlign = "left";
    ctx.textBaseline = "middle";
    const values = shown.log ? logTicks(scale.low, scale.high) : ticks(0, scale.high, 4);
    for (const value of values) {
      const part = scale.part(value);
      if (part >= -0.001 && part <= 1.001) ctx.fillText(number(value, 2), left + 16, bottom - part * (bottom - top));
    }
    ctx.textBaseline = "top";
    ctx.textAlign = "right";
    ctx.fillText(shown.unit, width - 4, bottom + 6);
  }

  const made = canvasIn(host, spec.title, () => shown.height ?? 340, draw);
  host.append(readout);

  made.canvas.addEventListener("pointermove", (event) => {
    if (!field || shown.rows.length === 0) return;
    const box = made.canvas.getBoundingClientRect();
    const across = (event.clientX - box.left - field.left) / (field.right - field.left);
    const up = 1 - (event.clientY - box.top - field.top) / (field.bottom - field.top);
    if (across < 0 || across >= 1 || up < 0 || up >= 1) {
      readout.textContent = shown.hint ?? "";
      return;
    }
    const r = Math.floor(up * shown.rows.length);
    const c = Math.floor(across * shown.rows[r].length);
    const value = (axis, part) => (axis.log ? axis.from * (axis.to / axis.from) ** part : axis.from + part * (axis.to - axis.from));
    const name = (axis, part) => `${axis.name ?? axis.label} ${(axis.text ?? ((v) => number(v, 4)))(value(axis, part))}`;
    readout.textContent = `${name(shown.x, across)}, ${name(shown.y, up)}: ${number(shown.rows[r][c])} ${shown.unit}`;
  });

  return {
    update(next) {
      shown = next;
      made.title(next.title);
      made.paint();
    },
    end: made.end,
  };
}
