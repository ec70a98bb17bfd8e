(() => {
  const canvas = document.getElementById("replay"), step = document.getElementById("step");
  const gl = canvas.getContext("webgl", { antialias: true });
  const caption = document.getElementById("caption");
  if (!gl) { caption.textContent = "This browser has no WebGL."; return; }
  const bytes = Uint8Array.from(atob(DATA.points), c => c.charCodeAt(0));
  const points = new Int16Array(bytes.buffer);
  const hue = (h) => [0, 4, 2].map(k => { const t = (h * 6 + k) % 6; return 0.15 + 0.75 * Math.min(Math.max(Math.abs(t - 3) - 1, 0), 1); });
  const colors = new Float32Array(points.length);
  let scan = 0;
  for (let i = 0; i < points.length / 3; i++) {
    while (i >= DATA.ends[scan]) scan++;
    colors.set(hue(scan / DATA.ends.length), 3 * i);
  }
  const rays = [], rayColors = [];
  DATA.cameras.forEach((c, i) => {
    const from = c.map(x => 0.75 * x), color = hue(i / DATA.cameras.length);
    rays.push(...from, ...c); rayColors.push(...color, ...color);
  });
  const shader = (type, source) => { const s = gl.createShader(type); gl.shaderSource(s, source); gl.compileShader(s); return s; };
  const program = gl.createProgram();
  gl.attachShader(program, shader(gl.VERTEX_SHADER, `attribute vec3 p; attribute vec3 c; uniform mat4 m; varying vec3 v;
    void main() { gl_Position = m * vec4(p, 1.0); gl_PointSize = 2.5; v = c; }`));
  gl.attachShader(program, shader(gl.FRAGMENT_SHADER, `precision mediump float; varying vec3 v; void main() { gl_FragColor = vec4(v, 1.0); }`));
  gl.linkProgram(program); gl.useProgram(program);
  const buffer = (data) => { const b = gl.createBuffer(); gl.bindBuffer(gl.ARRAY_BUFFER, b); gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW); return b; };
  const cloud = [buffer(points), gl.SHORT, true, buffer(colors)];
  const lines = [buffer(new Float32Array(rays)), gl.FLOAT, false, buffer(new Float32Array(rayColors))];
  const [p, c, m] = [gl.getAttribLocation(program, "p"), gl.getAttribLocation(program, "c"), gl.getUniformLocation(program, "m")];
  gl.enableVertexAttribArray(p); gl.enableVertexAttribArray(c); gl.enable(gl.DEPTH_TEST); gl.clearColor(1, 1, 1, 1);
  const draw = (mode, [position, type, normalized, color], count) => {
    gl.bindBuffer(gl.ARRAY_BUFFER, position); gl.vertexAttribPointer(p, 3, type, normalized, 0, 0);
    gl.bindBuffer(gl.ARRAY_BUFFER, color); gl.vertexAttribPointer(c, 3, gl.FLOAT, false, 0, 0);
    gl.drawArrays(mode, 0, count);
  };
  let yaw = 0.6, pitch = 0.4, held = false, last = [0, 0];
  canvas.onpointerdown = e => { held = true; last = [e.clientX, e.clientY]; canvas.setPointerCapture(e.pointerId); };
  canvas.onpointerup = () => { held = false; };
  canvas.onpointermove = e => {
    if (!held) return;
    yaw += (e.clientX - last[0]) * 0.01; pitch += (e.clientY - last[1]) * 0.01; last = [e.clientX, e.clientY];
  };
  const frame = () => {
    canvas.width = canvas.clientWidth; canvas.height = canvas.clientHeight; gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    if (!held) yaw += 0.004;
    const [sy, cy, sp, cp] = [Math.sin(yaw), Math.cos(yaw), Math.sin(pitch), Math.cos(pitch)];
    const s = 0.55, a = s * canvas.height / canvas.width;
    // Turn about z, tilt, orthographic.
    gl.uniformMatrix4fv(m, false, [a * cy, s * sp * sy, 0.3 * cp * sy, 0, -a * sy, s * sp * cy, 0.3 * cp * cy, 0, 0, s * cp, -0.3 * sp, 0, 0, 0, 0, 1]);
    const n = +step.value;
    draw(gl.POINTS, cloud, DATA.ends[n - 1]); draw(gl.LINES, lines, 2 * n);
    caption.textContent = `view ${n} of ${DATA.ends.length}: coverage ${DATA.coverages[n - 1]} %`;
    requestAnimationFrame(frame);
  };
  frame();
})();
