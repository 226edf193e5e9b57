// A canvas with axes of its own, drawn again when its size or the page's colours change.

import { h } from "./dom.js";
import { number } from "./format.js";
import { onPrefer } from "./prefs.js";
import { colour } from "./scale.js";

/** A canvas in `host`; `draw(ctx, width, height)` in px of the page. */
export function canvasIn(host, title, sizeOf, draw) {
  const canvas = h("canvas", { class: "drawn", role: "img", "aria-label": title });
  host.append(canvas);
  let width = 0;

  function paint() {
    if (width < 20) return;
    const ratio = devicePixelRatio || 1;
    const height = sizeOf(width);
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    canvas.style.height = `${height}px`;
    const ctx = canvas.getContext("2d");
    ctx.scale(ratio, ratio);
    ctx.font = "12px system-ui, sans-serif";
    draw(ctx, width, height);
  }

  const resized = new ResizeObserver(() => {
    if (Math.abs(canvas.clientWidth - width) < 1) return;
    width = canvas.clientWidth;
    paint();
  });
  resized.observe(canvas);
  const forget = onPrefer(paint);
  return {
    canvas,
    paint,
    title(text) {
      canvas.setAttribute("aria-label", text);
    },
    end() {
      resized.disconnect();
      forget();
    },
  };
}

/** Draws axes around a field; `x` and `y`: `{ticks, at, label, text}`. */
export function axes(ctx, field, x, y) {
  const { left, top, right, bottom } = field;
  ctx.strokeStyle = colour("line");
  ctx.fillStyle = colour("soft");
  ctx.lineWidth = 1;
  ctx.strokeRect(left + 0.5, top + 0.5, right - left - 1, bottom - top - 1);
  ctx.textAlign = "center";
  ctx.textBaseline = "top";
  for (const value of x.ticks) {
    const at = x.at(value);
    ctx.fillText(x.text ? x.text(value) : number(value, 4), at, bottom + 6);
    ctx.fillRect(at, bottom, 1, 4);
  }
  ctx.fillText(x.label, (left + right) / 2, bottom + 24);
  ctx.textAlign = "right";
  ctx.textBaseline = "middle";
  for (const value of y.ticks) {
    const at = y.at(value);
    ctx.fillText(y.text ? y.text(value) : number(value, 4), left - 7, at);
    ctx.fillRect(left - 4, at, 4, 1);
  }
  ctx.save();
  ctx.translate(13, (top + bottom) / 2);
  ctx.rotate(-Math.PI / 2);
  ctx.textAlign = "center";
  ctx.fillText(y.label, 0, 0);
  ctx.restore();
}
