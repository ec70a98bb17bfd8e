'use strict';
const D = JSON.parse(document.getElementById('data').textContent);
const $ = s => document.querySelector(s);
const bytes = s => Uint8Array.from(atob(s), c => c.charCodeAt(0)).buffer;
const edge = new Uint8Array(bytes(D.boundary)), born = new Uint32Array(bytes(D.born)), count = edge.length;
const joined = (a, b) => { const all = new a.constructor(a.length + b.length); all.set(a); all.set(b, a.length); return all; };
// The measured points, then those of the surface expected where nothing is known. Metres from the middle of the cloud, as
// everything that is drawn.
const positions = Float32Array.from(joined(new Int16Array(bytes(D.points)), new Int16Array(bytes(D.expected))), x => x * D.scale);
const normals = joined(new Int8Array(bytes(D.normals)), new Int8Array(bytes(D.outwards))), all = positions.length / 3;
const rel = p => [0, 1, 2].map(k => p[k] - D.center[k]);
const local = pose => pose.map((row, r) => [...row.slice(0, 3), row[3] - (D.center[r] ?? 0)]).slice(0, 3);
const apply = (m, p) => m.map(r => r[0] * p[0] + r[1] * p[1] + r[2] * p[2] + r[3]);
const column = (m, k) => m.map(r => r[k]);
const ramp = t => { const c = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]], x = Math.max(0, Math.min(1, t)) * 4, i = Math.min(3, Math.floor(x)); return c[i].map((v, k) => (v + (c[i + 1][k] - v) * (x - i)) / 255); };
const BLUE = [0.3, 0.55, 1], GOLD = [0.93, 0.66, 0.05], PINK = [0.84, 0.25, 0.62], TEAL = [0.07, 0.65, 0.58], ORANGE = [1, 0.55, 0.1];

const candidates = D.candidates.map(c => ({ ...c, pose: local(c.pose), target: rel(c.target) }));
// Of each camera the scan that it is of, from 0: a line scan has several.
const past = D.past.map(p => ({ pose: local(p.pose), scan: p.scan }));
const scores = candidates.filter(c => !c.why.length).map(c => c.score), low = Math.min(...scores), high = Math.max(...scores);
const tint = c => c.why.length ? [0.53, 0.53, 0.53] : ramp(high > low ? 0.15 + 0.7 * (c.score - low) / (high - low) : 0.6);
let chosen = D.next, step = D.scans;
const layers = { missing: true, boundary: true, overlap: true, candidates: true, out: false, past: true };

// Cameras stand near the object, in their true direction, unless true distances are asked for.
const radius = Math.max(D.radius, 1e-9);
const farthest = Math.max(radius, ...candidates.map(c => Math.hypot(...column(c.pose, 3))), ...past.map(p => Math.hypot(...column(p.pose, 3))));
const near = pose => {
  if ($('#far').checked) return pose;
  const at = column(pose, 3), by = Math.min(1, 2 * radius / (Math.hypot(...at) || 1));
  return pose.map((r, k) => [r[0], r[1], r[2], at[k] * by]);
};
function frustum(lines, faces, pose, length, color, fill) {
  const [l, r, t, b] = D.image.map(v => v * length), corners = [[l, t], [r, t], [r, b], [l, b]].map(([x, y]) => apply(pose, [x, y, length]));
  const apex = column(pose, 3), top = apply(pose, [(l + r) / 2, t * 1.4, length]);
  const segment = (p, q) => lines.push(...p, ...color, 1, ...q, ...color, 1);
  corners.forEach((c, i) => { segment(apex, c); segment(c, corners[(i + 1) % 4]); if (fill) for (const p of [apex, c, corners[(i + 1) % 4]]) faces.push(...p, ...color, fill); });
  segment(corners[0], top); segment(corners[1], top);
}
// Which points of the cloud a camera sees: the nearest in cells of about the spacing.
function seenFrom(pose) {
  const seen = new Uint8Array(all), eye = column(pose, 3), cells = new Map(), at = new Int32Array(all), depth = new Float32Array(all);
  const width = 2 * D.spacing / Math.max(Math.hypot(...eye), 1e-9);
  for (let i = 0; i < all; i++) {
    const d = [0, 1, 2].map(k => positions[3 * i + k] - eye[k]), facing = d.reduce((s, x, k) => s + x * normals[3 * i + k], 0);
    const [x, y, z] = [0, 1, 2].map(k => pose[0][k] * d[0] + pose[1][k] * d[1] + pose[2][k] * d[2]);
    const [u, v] = [x / z, y / z];
    if (z <= 0 || facing >= 0 || u < D.image[0] || u > D.image[1] || v < D.image[2] || v > D.image[3]) { depth[i] = -1; continue; }
    depth[i] = z;
    const key = Math.round(u / width) * 65536 + Math.round(v / width);
    at[i] = key;
    if (!(cells.get(key) < z)) cells.set(key, z);
  }
  for (let i = 0; i < all; i++) seen[i] = depth[i] > 0 && depth[i] < cells.get(at[i]) + 4 * D.spacing ? 1 : 0;
  return seen;
}
const view = viewer($('canvas'), { up: D.up, radius, dist: 4.8 * radius, yaw: 0.7, after: place });
// What is shown at a step of the replay; the last shows the plan.
function build() {
  const last = step === D.scans, c = last ? candidates[chosen] : past.find(p => p.scan === step);
  const seen = c ? seenFrom(c.pose) : new Uint8Array(all), shown = [], colors = [];
  const light = [0.35, -0.5, 0.79];
  for (let i = 0; i < all; i++) {
    const measured = i < count, rim = measured && last && layers.boundary && edge[i];
    if (measured ? born[i] >= step : !last || !layers.missing) continue;
    const n = [0, 1, 2].map(k => normals[3 * i + k] / 127), shade = 0.58 + 0.42 * Math.max(-0.6, n[0] * light[0] + n[1] * light[1] + n[2] * light[2]);
    const base = rim ? ORANGE : !measured ? (seen[i] ? PINK : [0.86, 0.72, 0.8]) : seen[i] && layers.overlap ? TEAL : [0.66, 0.7, 0.76];
    shown.push(positions[3 * i], positions[3 * i + 1], positions[3 * i + 2]);
    colors.push(...base.map(v => Math.min(1, v * (rim ? 1 : 0.35 + shade * 0.8))));
  }
  const lines = [], faces = [], size = 0.11 * (($('#far').checked) ? Math.max(radius, 0.5 * farthest) : radius);
  if (layers.past) past.filter(p => p.scan < step).forEach(p => frustum(lines, faces, near(p.pose), 1.6 * size, BLUE, 0.12));
  if (last) {
    candidates.forEach((c, i) => { if (i !== chosen && (c.why.length ? layers.out : layers.candidates)) frustum(lines, faces, near(c.pose), size, tint(c), 0); });
  }
  if (c) {
    const pose = near(c.pose), at = column(pose, 3);
    frustum(lines, faces, pose, 3.6 * size, GOLD, 0.16);
    if (c.target) lines.push(...at, ...GOLD, 1, ...c.target, ...GOLD, 1);
  }
  triad(lines);
  view.cloud(new Float32Array(shown), new Float32Array(colors), D.spacing * 1.25);
  view.shapes(lines, faces);
  // As the view sees the object, which fills the inset.
  const distance = c ? Math.hypot(...column(c.pose, 3)) : 0, spread = 1.15 * radius / Math.max(distance, radius);
  const whole = c && [Math.min(spread, D.image[1] - D.image[0]), Math.min(spread, D.image[1] - D.image[0])];
  view.look(c && centered(c.pose), whole);
  $('#inset').hidden = !c;
  $('#inset').textContent = last ? 'as the next view sees it' : 'as the next scan saw it';
  view.draw();
}
// The pose turned to the middle of the cloud, image up kept.
function centered(pose) {
  const at = column(pose, 3), l = Math.hypot(...at) || 1, z = at.map(x => -x / l), y0 = column(pose, 1), s = z.reduce((t, x, k) => t + x * y0[k], 0);
  const y1 = y0.map((x, k) => x - s * z[k]), m = Math.hypot(...y1) || 1, y = y1.map(x => x / m), x = [y[1] * z[2] - y[2] * z[1], y[2] * z[0] - y[0] * z[2], y[0] * z[1] - y[1] * z[0]];
  return [0, 1, 2].map(k => [x[k], y[k], z[k], at[k]]);
}
// Axes of a round length under the cloud, so that size and direction can be read.
const nice = x => { const p = 10 ** Math.floor(Math.log10(x)); return (x / p >= 5 ? 5 : x / p >= 2 ? 2 : 1) * p; };
const unitLength = nice(0.6 * radius), corner = D.up.map(x => -1.3 * radius * x);
const inUnits = m => m >= 1 ? `${+m.toFixed(2)} m` : m >= 0.01 ? `${+(100 * m).toFixed(1)} cm` : `${+(1000 * m).toFixed(2)} mm`;
const AXES = [['x', [0.9, 0.25, 0.25]], ['y', [0.2, 0.65, 0.25]], ['z', [0.3, 0.5, 1]]];
function triad(lines) { AXES.forEach(([, color], k) => { const end = [...corner]; end[k] += unitLength; lines.push(...corner, ...color, 1, ...end, ...color, 1); }); }
function place() {
  if (!view) return;
  // The frame of the inset, as large as the viewer draws it.
  const side = `${Math.round(Math.min(0.34 * $('canvas').clientWidth, 0.38 * $('canvas').clientHeight))}px`;
  $('#inset').style.width = $('#inset').style.height = side;
  const spots = AXES.map(([name], k) => { const p = [...corner]; p[k] += unitLength * 1.13; return [p, k ? name : `${name} ${inUnits(unitLength)}`]; });
  const tip = D.up.map(x => x * 1.45 * radius);
  spots.push([tip, 'up ↑']);
  if (step === D.scans && candidates[chosen]) spots.push([column(near(candidates[chosen].pose), 3), chosen === D.next ? 'next view' : `candidate ${chosen}`]);
  $('#labels').replaceChildren(...spots.map(([p, text]) => { const s = document.createElement('span'), at = view.project(p); s.textContent = text; if (at) { s.style.left = at[0] + 'px'; s.style.top = at[1] + 'px'; } else s.hidden = true; return s; }));
}
function choose(i) {
  chosen = (i + candidates.length) % candidates.length;
  document.querySelectorAll('tr.row').forEach((r, k) => r.classList.toggle('on', k === chosen));
  if (view) build();
}
const percent = x => x == null ? '' : (100 * x).toFixed(1);
candidates.forEach((c, i) => {
  const row = document.createElement('tr');
  const cell = text => { const td = document.createElement('td'); td.textContent = text; row.append(td); return td; };
  row.className = 'row'; row.tabIndex = 0;
  const key = document.createElement('i');
  key.style.background = `rgb(${tint(c).map(v => Math.round(255 * v)).join()})`;
  cell('').append(key, String(i));
  cell(c.score.toFixed(3)); cell(percent(c.gain)); cell(percent(c.overlap)); cell(c.at.map(x => x.toFixed(3)).join(' ') + (c.stop == null ? '' : `, table ${+c.stop.toFixed(1)}°`));
  row.onclick = () => choose(i);
  row.onkeydown = e => { if (e.key === 'Enter' || e.key === ' ') { e.preventDefault(); choose(i); } };
  $('#rows').append(row);
  if (!c.why.length) return;
  const why = document.createElement('tr'), td = document.createElement('td');
  td.colSpan = 5; td.className = 'why'; td.textContent = c.why.join('; ');
  why.append(td); $('#rows').append(why);
});
if (view) {
  const next = candidates[chosen];
  if (next) { const d = column(next.pose, 3), u = D.up, side = Math.abs(u[2]) > 0.9 ? Math.atan2(d[1], d[0]) : 0; if (side) view.eye.yaw = side + 0.55 - (u[2] > 0.9 ? Math.PI / 2 : 0); }
  for (const box of document.querySelectorAll('[data-layer]')) box.onchange = () => { layers[box.dataset.layer] = box.checked; build(); };
  $('#far').onchange = () => { view.home($('#far').checked ? 3 * farthest : 4.8 * radius); build(); };
  addEventListener('keydown', e => { if (e.key === 'n' || e.key === 'p') choose(chosen + (e.key === 'n' ? 1 : -1)); });
  $('#step').max = D.scans; $('#step').value = D.scans;
  const at = k => { step = k; $('#step').value = k; $('#caption').textContent = `after ${k} scan${k > 1 ? 's' : ''}${D.coverage[k - 1] == null ? '' : `: ${(100 * D.coverage[k - 1]).toFixed(1)} % covered`}`; build(); };
  $('#step').oninput = () => at(+$('#step').value);
  let timer = 0;
  $('#play').onclick = () => { clearInterval(timer); let k = 1; at(k); timer = setInterval(() => k < D.scans ? at(++k) : clearInterval(timer), 900); };
  $('#replay').hidden = D.scans < 2 || !past.length;
  if (!$('#replay').hidden) at(D.scans);
} else $('#none').hidden = false;
if (candidates.length) choose(Math.max(chosen, 0)); else if (view) build();
