// Points, lines and faces in WebGL 1, turned by mouse, finger and keyboard. No library; the pages carry this text.
// viewer(canvas, {up, radius, yaw, dist}) -> null without WebGL, else
//   cloud(positions, colors, size)   points of this size in scene units, shaded by the caller
//   shapes(lines, faces)             x y z r g b per corner; x y z r g b a per corner, faces see-through
//   look(pose, tan)                  a second picture in the lower left corner, from a camera (or null); tan: half its field of view
//   draw(), eye, home(), project(p) -> [x, y] in CSS pixels or null
'use strict';
function viewer(canvas, { up = [0, 0, 1], radius = 1, yaw = 0.7, dist = 3.2 * radius, after = () => {} }) {
  const gl = canvas.getContext('webgl', { antialias: true, preserveDrawingBuffer: true });
  if (!gl) return null;
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = a => { const l = Math.hypot(...a) || 1; return a.map(v => v / l); };
  const compile = (vertex, fragment) => {
    const program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    return program;
  };
  const paint = 'precision mediump float;varying vec4 v;void main(){gl_FragColor=v;}';
  const dots = compile(`attribute vec3 p,c;uniform mat4 m;uniform vec2 s;varying vec4 v;
    void main(){gl_Position=m*vec4(p,1.);v=vec4(c,1.);gl_PointSize=clamp(s.x/gl_Position.w,1.5*s.y,12.*s.y);}`, paint);
  const shape = compile('attribute vec3 p;attribute vec4 c;uniform mat4 m;varying vec4 v;void main(){gl_Position=m*vec4(p,1.);v=c;}', paint);
  const [position, color, corner, area] = [0, 1, 2, 3].map(() => gl.createBuffer());
  const fill = (buffer, data) => { gl.bindBuffer(gl.ARRAY_BUFFER, buffer); gl.bufferData(gl.ARRAY_BUFFER, data, gl.DYNAMIC_DRAW); };
  let count = 0, size = 0, corners = 0, areas = 0, from = null, spread = [1, 1];
  const home = { yaw, pitch: 0.42, dist, pan: [0, 0, 0] };
  const eye = { ...home, pan: [0, 0, 0] };

  // Axes of the scene about which it is turned.
  const vertical = unit(up), ahead = unit(cross(Math.abs(vertical[2]) > 0.9 ? [0, 1, 0] : [0, 0, 1], vertical)), aside = cross(vertical, ahead);
  function orbit() {
    const c = Math.cos(eye.pitch), v = [c * Math.cos(eye.yaw), c * Math.sin(eye.yaw), Math.sin(eye.pitch)];
    const back = [0, 1, 2].map(i => ahead[i] * v[0] + aside[i] * v[1] + vertical[i] * v[2]);
    const right = unit(cross(vertical, back));
    return { back, right, top: cross(back, right), at: back.map((x, i) => x * eye.dist + eye.pan[i]) };
  }
  // Column-major: clip space from the scene. `tan` of half the field of view, horizontally and vertically.
  function matrix({ right, top, back, at }, tan, near, far) {
    const view = [];
    for (let i = 0; i < 3; i++) view.push(right[i], top[i], back[i], 0);
    view.push(-dot(right, at), -dot(top, at), -dot(back, at), 1);
    const proj = [1 / tan[0], 0, 0, 0, 0, 1 / tan[1], 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, 2 * far * near / (near - far), 0];
    const m = new Float32Array(16);
    for (let c = 0; c < 4; c++) for (let r = 0; r < 4; r++) for (let i = 0; i < 4; i++) m[c * 4 + r] += proj[i * 4 + r] * view[c * 4 + i];
    return m;
  }
  function attribute(program, name, parts, stride, offset) {
    const at = gl.getAttribLocation(program, name);
    gl.enableVertexAttribArray(at);
    gl.vertexAttribPointer(at, parts, gl.FLOAT, false, stride, offset);
  }
  function render([x, y, w, h], m, tan, k, everything) {
    gl.viewport(x, y, w, h);
    gl.scissor(x, y, w, h);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.useProgram(dots);
    gl.bindBuffer(gl.ARRAY_BUFFER, position); attribute(dots, 'p', 3, 0, 0);
    gl.bindBuffer(gl.ARRAY_BUFFER, color); attribute(dots, 'c', 3, 0, 0);
    gl.uniformMatrix4fv(gl.getUniformLocation(dots, 'm'), false, m);
    gl.uniform2f(gl.getUniformLocation(dots, 's'), size * h / (2 * tan[1]), k);
    gl.drawArrays(gl.POINTS, 0, count);
    if (!everything) return;
    gl.useProgram(shape);
    gl.uniformMatrix4fv(gl.getUniformLocation(shape, 'm'), false, m);
    gl.enable(gl.BLEND);
    gl.depthMask(false);
    gl.bindBuffer(gl.ARRAY_BUFFER, area); attribute(shape, 'p', 3, 28, 0); attribute(shape, 'c', 4, 28, 12);
    gl.drawArrays(gl.TRIANGLES, 0, areas);
    gl.depthMask(true);
    gl.disable(gl.BLEND);
    gl.bindBuffer(gl.ARRAY_BUFFER, corner); attribute(shape, 'p', 3, 28, 0); attribute(shape, 'c', 4, 28, 12);
    gl.drawArrays(gl.LINES, 0, corners);
  }
  let now = null;
  function draw() {
    const k = window.devicePixelRatio || 1, w = canvas.clientWidth, h = canvas.clientHeight;
    if (!w || !h) return;
    canvas.width = w * k; canvas.height = h * k;
    const background = getComputedStyle(canvas).backgroundColor.match(/[\d.]+/g).map(v => v / 255);
    gl.clearColor(background[0], background[1], background[2], 1);
    gl.enable(gl.DEPTH_TEST); gl.enable(gl.SCISSOR_TEST); gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    // The narrower side shows 40 degrees.
    const half = 0.364, tan = w > h ? [half * w / h, half] : [half, half * h / w];
    now = { m: matrix(orbit(), tan, eye.dist / 100, 20 * eye.dist + 20 * radius), w, h };
    render([0, 0, canvas.width, canvas.height], now.m, tan, k, true);
    if (from) {
      const edge = Math.round(Math.min(0.34 * w, 0.38 * h)) * k;
      const far = Math.hypot(...from.at) + 4 * radius;
      render([0, 0, edge, Math.round(edge * spread[1] / spread[0])], matrix(from, spread, far / 1000, far), spread, k, false);
    }
    after();
  }
  const turn = (dx, dy) => { eye.yaw -= dx; eye.pitch = Math.max(-1.55, Math.min(1.55, eye.pitch + dy)); draw(); };
  const zoom = by => { eye.dist *= by; draw(); };
  function shift(dx, dy) {
    const { right, top } = orbit(), k = 0.73 * eye.dist / canvas.clientHeight;
    for (let i = 0; i < 3; i++) eye.pan[i] += (-dx * right[i] + dy * top[i]) * k;
    draw();
  }
  const held = new Map();
  canvas.addEventListener('pointerdown', e => { held.set(e.pointerId, [e.clientX, e.clientY]); canvas.setPointerCapture(e.pointerId); });
  for (const end of ['pointerup', 'pointercancel']) canvas.addEventListener(end, e => held.delete(e.pointerId));
  canvas.addEventListener('contextmenu', e => e.preventDefault());
  canvas.addEventListener('pointermove', e => {
    const last = held.get(e.pointerId);
    if (!last) return;
    const [dx, dy] = [e.clientX - last[0], e.clientY - last[1]];
    const gap = () => { const [a, b] = [...held.values()]; return Math.hypot(a[0] - b[0], a[1] - b[1]); };
    if (held.size > 1) {
      const before = gap();
      held.set(e.pointerId, [e.clientX, e.clientY]);
      zoom(before / Math.max(gap(), 1));
      return;
    }
    held.set(e.pointerId, [e.clientX, e.clientY]);
    if (e.buttons & 2 || e.shiftKey) shift(dx, dy); else turn(0.008 * dx, 0.008 * dy);
  });
  canvas.addEventListener('wheel', e => { e.preventDefault(); zoom(Math.exp(e.deltaY * 0.001)); }, { passive: false });
  canvas.tabIndex = 0;
  const keys = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] };
  canvas.addEventListener('keydown', e => {
    if (keys[e.key]) e.shiftKey ? shift(200 * keys[e.key][0], -200 * keys[e.key][1]) : turn(...keys[e.key]);
    else if (e.key === '+' || e.key === '=') zoom(0.9);
    else if (e.key === '-') zoom(1 / 0.9);
    else if (e.key === '0') { Object.assign(eye, home, { pan: [0, 0, 0] }); draw(); }
    else return;
    e.preventDefault();
  });
  addEventListener('resize', draw);
  matchMedia('(prefers-color-scheme: dark)').addEventListener('change', draw);
  return {
    eye, draw,
    home(distance = home.dist) { Object.assign(eye, { dist: distance, pan: [0, 0, 0] }); draw(); },
    cloud(positions, colors, pointSize) { count = positions.length / 3; size = pointSize; fill(position, positions); fill(color, colors); },
    shapes(lines, faces) { corners = lines.length / 7; areas = faces.length / 7; fill(corner, new Float32Array(lines)); fill(area, new Float32Array(faces)); },
    look(pose, tan) {
      spread = tan || spread;
      from = pose && { right: [0, 1, 2].map(r => pose[r][0]), top: [0, 1, 2].map(r => -pose[r][1]), back: [0, 1, 2].map(r => -pose[r][2]), at: [0, 1, 2].map(r => pose[r][3]) };
    },
    project(p) {
      if (!now) return null;
      const c = [0, 1, 3].map(r => now.m[r] * p[0] + now.m[4 + r] * p[1] + now.m[8 + r] * p[2] + now.m[12 + r]);
      return c[2] > 0 ? [(0.5 + 0.5 * c[0] / c[2]) * now.w, (0.5 - 0.5 * c[1] / c[2]) * now.h] : null;
    },
  };
}
