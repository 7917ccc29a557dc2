// The floor on a canvas: what stands still is drawn once, robots glide between the steps.

import { robotState, WALL } from './words.js';

const JUMP = 3; // cells: further than a robot drives in a step
const MARGIN = 0.6; // cells around the map

export class FloorMap {
  constructor(canvas, site) {
    this.canvas = canvas;
    this.context = canvas.getContext('2d');
    this.still = document.createElement('canvas');
    this.site = site;
    this.height = site.rows.length;
    this.width = Math.max(...site.rows.map((row) => row.length));
    this.robots = new Map(); // id -> { row, from, to, beganMs, x, y, theta }
    this.plans = {};
    this.blocked = [];
    this.placed = [];
    this.faultyChargers = [];
    this.showPaths = true;
    this.showNames = false;
    this.hover = null; // cell under the pointer or the keyboard's cursor
    this.selected = null; // { robot } or { cell }
    this.stepMs = 1000 * (site.stepS ?? 0.5);
    this.steppedMs = 0;
    this.step = -1;
    this.frames = 0;
    this.dirty = true;
    canvas.parentElement.style.setProperty('--shape', (this.height + 2 * MARGIN) / (this.width + 2 * MARGIN));
    new ResizeObserver(() => this.resize()).observe(canvas.parentElement);
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => this.restyle());
    this.restyle();
    requestAnimationFrame((nowMs) => this.frame(nowMs));
  }

  // What changes

  takeFloor(floor) {
    const nowMs = performance.now();
    if (floor.step !== this.step) this.learnPace(nowMs, floor.step);
    const gone = new Set(this.robots.keys());
    for (const row of floor.robots) {
      gone.delete(row.id);
      this.takeRobot(row, nowMs);
    }
    for (const id of gone) this.robots.delete(id);
    const marks = JSON.stringify([floor.blocked, floor.placed, floor.faultyChargers]);
    if (marks !== this.marks) {
      this.marks = marks;
      this.blocked = floor.blocked ?? [];
      this.placed = floor.placed ?? [];
      this.faultyChargers = floor.faultyChargers ?? [];
      this.drawStill();
    }
    this.dirty = true;
  }

  // How long a step takes is learned from when steps come, so that robots never stop in between.
  learnPace(nowMs, step) {
    const steps = step - this.step;
    if (this.step >= 0 && steps > 0 && steps < 10) {
      const each = (nowMs - this.steppedMs) / steps;
      if (each < 4 * this.stepMs) this.stepMs += 0.2 * (each - this.stepMs);
    }
    this.step = step;
    this.steppedMs = nowMs;
  }

  takeRobot(row, nowMs) {
    const to = { x: row.x, y: row.y, theta: row.theta ?? 0 };
    const robot = this.robots.get(row.id);
    if (!robot) {
      this.robots.set(row.id, { row, from: to, to, beganMs: nowMs, ...to });
      return;
    }
    robot.row = row;
    if (robot.to.x === to.x && robot.to.y === to.y && robot.to.theta === to.theta) return;
    const far = Math.hypot(to.x - robot.x, to.y - robot.y) > JUMP;
    robot.from = far ? to : { x: robot.x, y: robot.y, theta: robot.theta };
    robot.to = to;
    robot.beganMs = nowMs;
  }

  takePlans(plans) {
    this.plans = plans;
    this.dirty = true;
  }

  set(changes) {
    Object.assign(this, changes);
    this.dirty = true;
  }

  // Where things are

  resize() {
    const stage = this.canvas.parentElement;
    const wide = stage.clientWidth;
    const ratio = devicePixelRatio || 1;
    const most = Math.max(160, stage.clientHeight);
    const cell = Math.min(wide / (this.width + 2 * MARGIN), most / (this.height + 2 * MARGIN));
    if (!(cell > 0)) return;
    this.cell = cell;
    const width = Math.floor(cell * (this.width + 2 * MARGIN));
    const height = Math.floor(cell * (this.height + 2 * MARGIN));
    this.canvas.style.width = `${width}px`;
    this.canvas.style.height = `${height}px`;
    for (const canvas of [this.canvas, this.still]) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    this.ratio = ratio;
    this.drawStill();
  }

  cellAt(offsetX, offsetY) {
    const x = Math.floor(offsetX / this.cell - MARGIN);
    const y = Math.floor(offsetY / this.cell - MARGIN);
    return x < 0 || y < 0 || x >= this.width || y >= this.height ? null : [x, y];
  }

  robotAt(cell) {
    let best = null;
    let nearest = 0.75;
    for (const robot of this.robots.values()) {
      if (robot.row.status === 'removed') continue;
      const distance = Math.hypot(robot.x - cell[0], robot.y - cell[1]);
      if (distance < nearest) [best, nearest] = [robot.row.id, distance];
    }
    return best;
  }

  isWall([x, y]) {
    return (this.site.rows[y]?.[x] ?? WALL) === WALL;
  }

  // Drawing

  restyle() {
    const style = getComputedStyle(document.documentElement);
    const names = ['floor', 'grid', 'shelf', 'shelf-line', 'stock', 'ink', 'muted', 'panel', 'accent',
      'working', 'travelling', 'waiting', 'idle', 'charging', 'failed', 'on-robot', 'box'];
    this.colours = Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
    this.font = style.getPropertyValue('--font');
    this.drawStill();
  }

  scale(context) {
    const unit = this.cell * this.ratio;
    context.setTransform(unit, 0, 0, unit, (MARGIN + 0.5) * unit, (MARGIN + 0.5) * unit);
  }

  drawStill() {
    this.dirty = true;
    if (!this.cell) return;
    const c = this.still.getContext('2d');
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.clearRect(0, 0, this.still.width, this.still.height);
    this.scale(c);
    c.fillStyle = this.colours.floor;
    rounded(c, -0.5 - MARGIN / 2, -0.5 - MARGIN / 2, this.width + MARGIN, this.height + MARGIN, 0.5);
    c.fill();
    this.drawGrid(c);
    this.drawShelves(c);
    for (const place of Object.values(this.site.robots)) this.drawHome(c, place.home);
    for (const cell of this.site.chargers ?? []) this.drawCharger(c, cell);
    for (const [name, cell] of Object.entries(this.site.stations)) this.drawStation(c, name, cell);
    for (const cell of this.placed) this.drawPlaced(c, cell);
    for (const { cell } of this.blocked) this.drawBlocked(c, cell);
  }

  drawGrid(c) {
    c.fillStyle = this.colours.grid;
    const size = Math.max(0.05, 1 / this.cell);
    this.site.rows.forEach((row, y) => [...row].forEach((kind, x) => {
      if (kind === WALL) return;
      if (kind === 'e') {
        c.fillStyle = this.colours.stock;
        c.fillRect(x - 0.46, y - 0.46, 0.92, 0.92);
      } else {
        c.fillStyle = this.colours.grid;
        c.beginPath();
        c.arc(x, y, size, 0, 7);
        c.fill();
      }
    }));
  }

  drawShelves(c) {
    c.fillStyle = this.colours.shelf;
    this.site.rows.forEach((row, y) => [...row].forEach((kind, x) => {
      if (kind !== WALL) return;
      const edge = (dx, dy) => (this.isWall([x + dx, y + dy]) ? 0 : 0.06);
      const [left, top] = [edge(-1, 0), edge(0, -1)];
      c.fillRect(x - 0.5 + left, y - 0.5 + top, 1.01 - left - edge(1, 0), 1.01 - top - edge(0, 1));
    }));
    c.fillStyle = this.colours['shelf-line'];
    const line = Math.max(0.04, 1 / (this.cell * this.ratio));
    this.site.rows.forEach((row, y) => [...row].forEach((kind, x) => {
      if (kind === WALL && this.isWall([x + 1, y]) && x + 1 < this.width) c.fillRect(x + 0.5 - line / 2, y - 0.32, line, 0.64);
    }));
  }

  drawHome(c, [x, y]) {
    c.strokeStyle = this.colours.grid;
    c.lineWidth = 0.07;
    c.beginPath();
    c.arc(x, y, 0.3, 0, 7);
    c.stroke();
  }

  drawCharger(c, [x, y]) {
    const faulty = this.faultyChargers.some(([a, b]) => a === x && b === y);
    const colour = faulty ? this.colours.failed : this.colours.charging;
    c.strokeStyle = colour;
    c.lineWidth = 0.09;
    rounded(c, x - 0.42, y - 0.42, 0.84, 0.84, 0.18);
    c.globalAlpha = 0.14;
    c.fillStyle = colour;
    c.fill();
    c.globalAlpha = 1;
    c.stroke();
    c.fillStyle = colour;
    polygon(c, x, y, [[0.06, -0.3], [-0.17, 0.06], [-0.01, 0.06], [-0.06, 0.3], [0.17, -0.06], [0.01, -0.06]]);
    if (faulty) cross(c, x, y, 0.36, this.colours.failed);
  }

  drawStation(c, name, [x, y]) {
    c.fillStyle = this.colours.accent;
    rounded(c, x - 0.46, y - 0.46, 0.92, 0.92, 0.2);
    c.fill();
    c.fillStyle = this.colours.panel;
    c.font = `700 0.58px ${this.font}`;
    c.textAlign = 'center';
    c.textBaseline = 'middle';
    c.fillText(/(\d+)$/.exec(name)?.[1] ?? name.charAt(0).toUpperCase(), x, y + 0.04);
  }

  drawPlaced(c, [x, y]) {
    c.strokeStyle = this.colours.failed;
    c.lineWidth = 0.09;
    c.setLineDash([0.18, 0.14]);
    rounded(c, x - 0.38, y - 0.38, 0.76, 0.76, 0.08);
    c.stroke();
    c.setLineDash([]);
  }

  drawBlocked(c, [x, y]) {
    c.save();
    rounded(c, x - 0.44, y - 0.44, 0.88, 0.88, 0.1);
    c.clip();
    c.fillStyle = this.colours.failed;
    c.globalAlpha = 0.18;
    c.fillRect(x - 0.5, y - 0.5, 1, 1);
    c.globalAlpha = 1;
    c.strokeStyle = this.colours.failed;
    c.lineWidth = 0.1;
    c.beginPath();
    for (let d = -1; d <= 1; d += 0.32) {
      c.moveTo(x + d - 0.5, y + 0.5);
      c.lineTo(x + d + 0.5, y - 0.5);
    }
    c.stroke();
    c.restore();
    c.strokeStyle = this.colours.failed;
    c.lineWidth = 0.08;
    rounded(c, x - 0.44, y - 0.44, 0.88, 0.88, 0.1);
    c.stroke();
  }

  frame(nowMs) {
    requestAnimationFrame((next) => this.frame(next));
    this.frames += 1;
    const moving = this.move(nowMs);
    if (!this.cell || !(moving || this.dirty)) return;
    this.dirty = false;
    const c = this.context;
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.clearRect(0, 0, this.canvas.width, this.canvas.height);
    c.drawImage(this.still, 0, 0);
    this.scale(c);
    if (this.showPaths) this.drawPaths(c);
    this.drawSelection(c);
    for (const robot of this.robots.values()) if (robot.row.status !== 'removed') this.drawRobot(c, robot);
    if (this.showNames) this.drawNames(c);
    this.drawHover(c);
  }

  // A little longer than a step: a step that comes late finds its robots still on their way.
  move(nowMs) {
    let moving = false;
    const lastsMs = Math.min(1500, Math.max(60, this.stepMs * 1.08));
    for (const robot of this.robots.values()) {
      const part = Math.min(1, (nowMs - robot.beganMs) / lastsMs);
      const { from, to } = robot;
      if (robot.x === to.x && robot.y === to.y && robot.theta === to.theta) continue;
      moving = true;
      robot.x = part >= 1 ? to.x : from.x + (to.x - from.x) * part;
      robot.y = part >= 1 ? to.y : from.y + (to.y - from.y) * part;
      const turn = Math.atan2(Math.sin(to.theta - from.theta), Math.cos(to.theta - from.theta));
      robot.theta = part >= 1 ? to.theta : from.theta + turn * Math.min(1, part * 2.5);
    }
    return moving;
  }

  drawPaths(c) {
    c.lineCap = 'round';
    c.lineJoin = 'round';
    for (const robot of this.robots.values()) {
      const path = this.plans[robot.row.id]?.path;
      if (!path || path.length < 2 || robot.row.status === 'removed') continue;
      const bold = this.selected?.robot === robot.row.id;
      const { share } = robotState(robot.row.status);
      c.strokeStyle = this.colours[share === 'idle' ? 'muted' : share];
      c.globalAlpha = bold ? 1 : 0.5;
      c.lineWidth = bold ? 0.18 : 0.1;
      c.setLineDash(bold ? [] : [0.02, 0.24]);
      c.beginPath();
      c.moveTo(robot.x, robot.y);
      for (const [x, y] of ahead(path, robot)) c.lineTo(x, y);
      c.stroke();
      c.setLineDash([]);
      const [x, y] = path.at(-1);
      c.lineWidth = 0.1;
      c.beginPath();
      c.arc(x, y, 0.22, 0, 7);
      c.stroke();
    }
    c.globalAlpha = 1;
  }

  drawRobot(c, { row, x, y, theta }) {
    const { share } = robotState(row.status);
    const large = this.site.largeTypes.has(row.type);
    const size = large ? 0.4 : 0.36;
    c.save();
    c.translate(x, y);
    c.globalAlpha = row.status === 'silent' ? 0.6 : 1;
    this.drawBattery(c, row, size + 0.1);
    c.rotate(theta);
    c.fillStyle = this.colours[share];
    if (large) rounded(c, -size * 0.86, -size * 0.76, 1.72 * size, 1.52 * size, 0.08);
    else {
      c.beginPath();
      c.arc(0, 0, size * 0.97, 0, 7);
    }
    c.fill();
    c.fillStyle = this.colours['on-robot'];
    if (share === 'failed') {
      c.rotate(-theta);
      cross(c, 0, 0, 0.17, this.colours['on-robot']);
    } else {
      const tip = size * (large ? 0.78 : 0.86);
      polygon(c, 0, 0, [[tip, 0], [tip - 0.16, -0.15], [tip - 0.16, 0.15]]);
    }
    if (row.load) this.drawLoad(c, share === 'failed' ? 0.3 : -0.09);
    c.restore();
    if (share === 'failed') this.drawAlarm(c, x, y);
  }

  drawLoad(c, x) {
    const half = 0.14;
    c.fillStyle = this.colours.box;
    c.strokeStyle = this.colours['on-robot'];
    c.lineWidth = 0.05;
    c.beginPath();
    c.rect(x - half, (x > 0 ? x : 0) - half, 2 * half, 2 * half);
    c.fill();
    c.stroke();
  }

  drawAlarm(c, x, y) {
    c.strokeStyle = this.colours.failed;
    c.lineWidth = 0.1;
    rounded(c, x - 0.58, y - 0.58, 1.16, 1.16, 0.2);
    c.stroke();
  }

  drawBattery(c, row, radius) {
    const full = Math.max(0, Math.min(1, row.battery / 100));
    c.lineWidth = 0.08;
    c.fillStyle = this.colours.floor;
    c.strokeStyle = this.colours.grid;
    c.beginPath();
    c.arc(0, 0, radius, 0, 7);
    c.fill();
    c.stroke();
    c.strokeStyle = full < 0.25 ? this.colours.failed : row.charging ? this.colours.charging : this.colours.muted;
    c.beginPath();
    c.arc(0, 0, radius, -Math.PI / 2, -Math.PI / 2 + 2 * Math.PI * full);
    c.stroke();
  }

  drawNames(c) {
    const size = Math.max(0.5, 9 / this.cell);
    c.font = `600 ${size}px ${this.font}`;
    c.textAlign = 'center';
    c.textBaseline = 'alphabetic';
    c.lineJoin = 'round';
    c.lineWidth = size * 0.3;
    for (const { row, x, y } of this.robots.values()) {
      if (row.status === 'removed') continue;
      const name = row.id.replace(/^([a-z])[a-z]*-?(\d+)$/i, '$1$2');
      c.strokeStyle = this.colours.floor;
      c.strokeText(name, x, y - 0.48);
      c.fillStyle = this.colours.ink;
      c.fillText(name, x, y - 0.48);
    }
  }

  drawSelection(c) {
    if (!this.selected) return;
    const robot = this.robots.get(this.selected.robot);
    const at = robot ?? (this.selected.cell && { x: this.selected.cell[0], y: this.selected.cell[1] });
    if (!at) return;
    c.strokeStyle = this.colours.ink;
    c.lineWidth = 0.1;
    rounded(c, at.x - 0.72, at.y - 0.72, 1.44, 1.44, 0.26);
    c.stroke();
  }

  drawHover(c) {
    if (!this.hover) return;
    const [x, y] = this.hover;
    c.strokeStyle = this.colours.ink;
    c.globalAlpha = 0.55;
    c.lineWidth = 0.06;
    rounded(c, x - 0.5, y - 0.5, 1, 1, 0.14);
    c.stroke();
    c.globalAlpha = 1;
  }
}

// A plan may be a step old: only what lies before the robot is drawn.
function ahead(path, robot) {
  const here = path.findIndex(([x, y]) => Math.hypot(x - robot.to.x, y - robot.to.y) < 0.6);
  return path.slice(Math.max(0, here));
}

function rounded(c, x, y, width, height, radius) {
  c.beginPath();
  c.roundRect(x, y, width, height, radius);
}

function polygon(c, x, y, points) {
  c.beginPath();
  points.forEach(([dx, dy], index) => (index ? c.lineTo(x + dx, y + dy) : c.moveTo(x + dx, y + dy)));
  c.closePath();
  c.fill();
}

function cross(c, x, y, half, colour) {
  c.lineCap = 'round';
  c.lineWidth = 0.11;
  c.strokeStyle = colour;
  c.beginPath();
  c.moveTo(x - half, y - half);
  c.lineTo(x + half, y + half);
  c.moveTo(x + half, y - half);
  c.lineTo(x - half, y + half);
  c.stroke();
}
