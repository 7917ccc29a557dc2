// The last ten minutes of each route, in steps of some seconds, and their lines.

import { setAttr, svg } from './shared/dom.js';
import { onItsWay } from './words.js';

const RATE = 1;
const HELD = 2;

export class History {
  constructor() {
    this.routes = new Map();
    this.step = 5;
    this.span = 600;
    this.last = 0;
  }

  // What the server has kept, behind what this page has seen before that.
  load({ step_s: step, span_s: span, routes }) {
    [this.step, this.span] = [step, span];
    for (const [name, points] of Object.entries(routes)) {
      const begin = points.length ? points[0][0] : Infinity;
      // A server that was started again knows less than this page.
      const before = (this.routes.get(name) ?? []).filter((p) => p[0] < begin);
      this.routes.set(name, [...before, ...points.map((p) => [...p, p[RATE] === null ? 0 : 1])]);
    }
  }

  // One report: the rate goes into the mean of its step, what is held into the most of it.
  // What a route of `reading` held is not known where its lag is not.
  add(nowS, routes, reading) {
    const at = Math.floor(nowS / this.step) * this.step;
    this.last = at;
    const known = new Set();
    for (const route of routes) {
      known.add(route.name);
      const held = route.lag ?? (reading.has(route.name) ? null : onItsWay(route));
      const points = this.routes.get(route.name) ?? [];
      const newest = points.at(-1);
      if (newest && newest[0] === at) {
        if (route.rate !== null) {
          newest[3] += 1;
          newest[RATE] = (newest[RATE] ?? 0) + (route.rate - (newest[RATE] ?? 0)) / newest[3];
        }
        if (held !== null) newest[HELD] = Math.max(newest[HELD] ?? 0, held);
      } else {
        points.push([at, route.rate, held, route.rate === null ? 0 : 1]);
      }
      while (points.length && points[0][0] < at - this.span) points.shift();
      this.routes.set(route.name, points);
    }
    for (const name of this.routes.keys()) if (!known.has(name)) this.routes.delete(name);
  }

  // [seconds ago, value] of a route where that is known, and the largest value.
  series(name, which) {
    const points = (this.routes.get(name) ?? []).map((p) => [p[0] - this.last, p[which]]).filter((p) => p[1] !== null);
    return { points, most: points.length ? Math.max(...points.map((p) => p[1])) : null };
  }

  // From when to when the lines go, by the clock of the server.
  get ends() { return [this.last - this.span, this.last]; }

  rates(name) { return this.series(name, RATE); }

  held(name) { return this.series(name, HELD); }
}

export function spark(width, height) {
  const line = svg('path', { class: 'line' });
  const area = svg('path', { class: 'area' });
  const node = svg('svg', { class: 'spark', viewBox: `0 0 ${width} ${height}`, preserveAspectRatio: 'none', 'aria-hidden': 'true' }, area, line);
  return Object.assign(node, { line, area, size: [width, height] });
}

export function drawSpark(node, { points, most }, spanS) {
  const [width, height] = node.size;
  const place = ([ago, value]) => {
    const x = width * (1 + ago / spanS);
    const y = height - 1.5 - (most ? (value / most) * (height - 4) : 0);
    return `${x.toFixed(1)},${y.toFixed(1)}`;
  };
  const shown = points.filter(([ago]) => ago >= -spanS);
  const path = shown.length > 1 ? `M${shown.map(place).join('L')}` : '';
  setAttr(node.line, 'd', path);
  const from = shown.length ? (width * (1 + shown[0][0] / spanS)).toFixed(1) : 0;
  setAttr(node.area, 'd', path && `${path}L${width},${height}L${from},${height}Z`);
}
