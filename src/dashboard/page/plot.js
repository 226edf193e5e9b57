// Lines over an axis: spectra, waveforms, trends. uPlot draws; cursors, limits and keys are ours.

import { h } from "./dom.js";
import { number } from "./format.js";
import { onPrefer } from "./prefs.js";
import { colour, extent } from "./scale.js";

const { uPlot } = globalThis;
const LINES = ["line-1", "line-2", "line-3", "line-4"];
/** Part of the width by which a key moves, and by which one zooms. */
const STEP = 0.15;
/** Width of a character of a cursor's label, px. */
const LABEL_PX = 7;

/** Values that a logarithmic axis can show: five decades below the largest. */
function logRange(series) {
  const found = extent(series.flatMap((one) => [...one.y]));
  if (!found || found[1] <= 0) return [1e-6, 1];
  const high = found[1];
  let low = Infinity;
  for (const one of series) for (const value of one.y) if (value > 0 && value < low) low = value;
  return [10 ** Math.floor(Math.log10(Math.max(low, high * 1e-5))), high * 2];
}

function linearRange(spec) {
  const limits = (spec.limits ?? []).map((limit) => limit.y);
  const found = extent([...spec.series.flatMap((one) => [...one.y]), ...limits]);
  if (!found) return [0, 1];
  let [low, high] = found;
  if (spec.fromZero) low = Math.min(low, 0);
  const room = (high - low || Math.abs(high) || 1) * 0.06;
  return [spec.fromZero && low === 0 ? 0 : low - room, high + room * (spec.cursors?.length ? 3 : 1)];
}

/** All series over one x axis, as uPlot wants them. */
function columns(spec) {
  if (spec.series.length === 0) return [[], []];
  const clean = (y) => (spec.log ? Array.from(y, (v) => (v > 0 ? v : null)) : y);
  const first = spec.series[0].x;
  if (spec.series.every((one) => one.x === first)) return [first, ...spec.series.map((one) => clean(one.y))];
  return uPlot.join(spec.series.map((one) => [one.x, clean(one.y)]));
}

/**
 * A plot in `host`. `spec`: `title`; `x` and `y` with `label`; `series` of `{name, x, y}`; `log`, `logX`, `fromZero`, `height`;
 * `cursors` of `{x, label, kind, y, isBand}` (kind `matched`, `expected`, `shaft`, `mark`); `limits` of `{y, label, kind}`; `usual` of `{x, y, low, high}`; `xValue(x)` and
 * `yValue(y)` for people; `onPick(x)`.
 */
export function linePlot(host, spec) {
  let shown = spec;
  let plot = null;
  let width = 0;
  const readout = h("p", { class: "readout", "aria-hidden": "true" });
  const frame = h("div", { class: "plot", tabindex: 0, role: "group" });
  host.append(frame, readout);

  const xText = (x) => (shown.xValue ? shown.xValue(x) : number(x, 4));
  const yText = (y) => (shown.yValue ? shown.yValue(y) : number(y));

  function drawCursors(u) {
    const { ctx } = u;
    const ratio = devicePixelRatio || 1;
    const { left, top, width: w, height: tall } = u.bbox;
    ctx.save();
    ctx.beginPath();
    ctx.rect(left, top, w, tall);
    ctx.clip();
    ctx.font = `${11 * ratio}px system-ui, sans-serif`;
    for (const limit of shown.limits ?? []) {
      const y = u.valToPos(limit.y, "y", true);
      ctx.strokeStyle = colour(limit.kind ?? "warning");
      ctx.setLineDash([6 * ratio, 4 * ratio]);
      ctx.lineWidth = ratio;
      line(ctx, left, y, left + w, y);
      ctx.fillStyle = colour(limit.kind ?? "warning");
      ctx.textAlign = "right";
      ctx.fillText(limit.label, left + w - 4 * ratio, y - 4 * ratio);
    }
    for (const bar of shown.usual ?? []) {
      const [x, y, low, high] = [u.valToPos(bar.x, "x", true), ...[bar.y, bar.low, bar.high].map((v) => u.valToPos(v, "y", true))];
      ctx.strokeStyle = colour("healthy");
      ctx.setLineDash([]);
      ctx.lineWidth = 3 * ratio;
      line(ctx, x - 6 * ratio, y, x + 6 * ratio, y);
      ctx.lineWidth = ratio;
      line(ctx, x, low, x, high);
    }
    // Labels in rows, so that neighbours can both be read.
    const ends = [-Infinity, -Infinity, -Infinity];
    const cursors = [...(shown.cursors ?? [])].sort((a, b) => a.x - b.x);
    for (const cursor of cursors) {
      if (cursor.x < u.scales.x.min || cursor.x > u.scales.x.max) continue;
      const x = u.valToPos(cursor.x, "x", true);
      const ink = colour(cursor.kind === "matched" ? "matched" : cursor.kind === "mark" ? "damaged" : "cursor");
      ctx.strokeStyle = ink;
      ctx.lineWidth = (cursor.kind === "matched" ? 1.5 : 1) * ratio;
      ctx.setLineDash(cursor.kind === "matched" ? [] : [3 * ratio, 3 * ratio]);
      const y = cursor.y === undefined || cursor.y === null ? null : u.valToPos(cursor.y, "y", true);
      line(ctx, x, top, x, y ?? top + tall);
      if (y !== null && y !== undefined) {
        ctx.setLineDash([]);
        ctx.beginPath();
        ctx.arc(x, y, 4 * ratio, 0, 2 * Math.PI);
        ctx.stroke();
      }
      const room = cursor.label.length * LABEL_PX * ratio;
      // Side bands below, so that the line they belong to has the first row.
      const row = ends.findIndex((end, i) => x > end && (i > 0 || !cursor.isBand));
      if (row < 0) continue;
      const isRight = x + room > left + w;
      ends[row] = isRight ? x : x + room;
      ctx.textAlign = isRight ? "right" : "left";
      ctx.fillStyle = ink;
      ctx.fillText(cursor.label, x + (isRight ? -4 : 4) * ratio, top + (12 + 13 * row) * ratio);
    }
    ctx.restore();
  }

  /** Of a logarithmic axis only the decades have a line across. */
  const decades = (_, splits) => splits.map((v) => (Math.abs(Math.log10(v) % 1) < 1e-6 ? v : null));

  function axis(label, values, size, isLog, space) {
    return {
      label,
      space,
      labelSize: 18,
      labelGap: 2,
      font: "12px system-ui, sans-serif",
      labelFont: "12px system-ui, sans-serif",
      stroke: colour("soft"),
      grid: { stroke: colour("grid"), width: 1, ...(isLog ? { filter: decades } : {}) },
      ticks: { stroke: colour("grid"), width: 1, size: 5 },
      size,
      values,
    };
  }

  function options() {
    const textsX = (_, splits) => splits.map((v) => (v === null ? null : shown.xTick ? shown.xTick(v) : number(v, 5)));
    const textsY = (_, splits) => splits.map((v) => (v === null ? null : number(v)));
    const yRange = shown.log ? logRange(shown.series) : linearRange(shown);
    return {
      width,
      height: shown.height ?? 280,
      // The last label of a time is as long as half a distance.
      padding: [10, shown.xTick ? 32 : 12, 0, 0],
      legend: { show: false },
      cursor: { drag: { x: true, y: false, setScale: true }, points: { size: 7 }, y: false },
      scales: {
        x: { time: false, ...(shown.logX ? { distr: 3, log: 10 } : {}) },
        y: { ...(shown.log ? { distr: 3, log: 10 } : {}), range: () => yRange },
      },
      axes: [axis(shown.x.label, textsX, 30, shown.logX, shown.xTick ? 90 : 55), axis(shown.y.label, textsY, 62, shown.log, 34)],
      series: [
        {},
        ...shown.series.map((one, i) => ({
          label: one.name,
          stroke: colour(one.ink ?? LINES[i % LINES.length]),
          width: one.width ?? 1.25,
          dash: one.dash,
          points: { show: one.points === true, size: 5 },
          spanGaps: false,
        })),
      ],
      hooks: { draw: [drawCursors], setCursor: [read], ready: [label] },
    };
  }

  function label(u) {
    u.ctx.canvas.setAttribute("role", "img");
    u.ctx.canvas.setAttribute("aria-label", shown.title);
  }

  function read(u) {
    const { idx } = u.cursor;
    if (idx === null || idx === undefined) {
      readout.textContent = shown.hint ?? "";
      return;
    }
    const values = shown.series.map((one, i) => {
      const y = u.data[i + 1][idx];
      const name = shown.series.length > 1 ? `${one.name} ` : "";
      return y === null || y === undefined ? null : `${name}${yText(y)}`;
    });
    readout.textContent = `${xText(u.data[0][idx])}: ${values.filter(Boolean).join("; ") || "no value"}`;
  }

  function make() {
    if (width < 50) return;
    plot?.destroy();
    plot = new uPlot(options(), columns(shown), frame);
    frame.setAttribute("aria-label", `${shown.title}. Left and right move, plus and minus zoom, 0 shows all.`);
    if (!readout.textContent) readout.textContent = shown.hint ?? "";
  }

  function move(key) {
    if (!plot) return false;
    const { min, max } = plot.scales.x;
    const w = max - min;
    const all = extent(plot.data[0]) ?? [min, max];
    const [low, high] = {
      ArrowLeft: [min - STEP * w, max - STEP * w],
      ArrowRight: [min + STEP * w, max + STEP * w],
      "+": [min + STEP * w, max - STEP * w],
      "-": [min - STEP * w, max + STEP * w],
      0: all,
    }[key] ?? [null, null];
    if (low === null) return false;
    plot.setScale("x", { min: Math.max(all[0], low), max: Math.min(all[1], high) });
    return true;
  }

  frame.addEventListener("keydown", (event) => {
    if (move(event.key === "=" ? "+" : event.key)) event.preventDefault();
  });
  frame.addEventListener("click", () => {
    const idx = plot?.cursor.idx;
    if (shown.onPick && idx !== null && idx !== undefined) shown.onPick(plot.data[0][idx], plot.data[1][idx]);
  });

  const resized = new ResizeObserver(() => {
    if (Math.abs(frame.clientWidth - width) < 1) return;
    width = frame.clientWidth;
    if (plot) plot.setSize({ width, height: shown.height ?? 280 });
    else make();
  });
  resized.observe(frame);
  const forget = onPrefer(make);

  return {
    /** Shows other data; the zoom stays where the axis does. */
    update(next) {
      const zoom = plot && !next.resetZoom && next.x.label === shown.x.label ? { ...plot.scales.x } : null;
      const all = plot && extent(plot.data[0]);
      shown = next;
      make();
      const isZoomed = zoom && all && (zoom.min > all[0] || zoom.max < all[1]);
      if (plot && isZoomed) plot.setScale("x", { min: zoom.min, max: zoom.max });
    },
    end() {
      resized.disconnect();
      forget();
      plot?.destroy();
      plot = null;
    },
  };
}

function line(ctx, x0, y0, x1, y1) {
  ctx.beginPath();
  ctx.moveTo(x0, y0);
  ctx.lineTo(x1, y1);
  ctx.stroke();
}
