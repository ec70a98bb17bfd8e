(() => {
  const $ = id => document.getElementById(id), caption = $('caption'), step = $('step');
  const scale = DATA.extent / 32767, points = Float32Array.from(new Int16Array(Uint8Array.from(atob(DATA.points), c => c.charCodeAt(0)).buffer), x => x * scale);
  const radius = 1.2 * DATA.extent, scans = DATA.ends.length;
  const view = viewer($('replay'), { up: [0, 0, 1], radius, dist: 5 * radius });
  if (!view) { caption.textContent = 'This browser has no WebGL.'; return; }
  const hue = h => [0, 4, 2].map(k => { const t = (h * 6 + k) % 6; return 0.1 + 0.75 * Math.min(Math.max(Math.abs(t - 3) - 1, 0), 1); });
  // Where scans were registered, red says that one failed.
  const registered = DATA.notes.some(note => note), paint = i => DATA.failed[i] ? [0.95, 0.1, 0.1] : hue(registered ? 0.25 + 0.5 * i / scans : i / scans);
  const colors = new Float32Array(points.length);
  for (let i = 0, scan = 0; i < points.length / 3; i++) {
    while (i >= DATA.ends[scan]) scan++;
    colors.set(paint(scan), 3 * i);
  }
  const show = n => {
    step.value = n;
    const lines = [];
    DATA.cameras.slice(0, n).forEach((d, i) => lines.push(...d.map(x => 1.2 * x * radius), ...paint(i), 1, ...d.map(x => (i + 1 < n ? 1.7 : 2.1) * x * radius), ...paint(i), 1));
    view.cloud(points.subarray(0, 3 * DATA.ends[n - 1]), colors.subarray(0, 3 * DATA.ends[n - 1]), DATA.spacing);
    view.shapes(lines, []);
    view.draw();
    caption.textContent = `view ${n} of ${scans}: coverage ${DATA.coverages[n - 1]} %${DATA.notes[n - 1]}`;
  };
  let timer = 0;
  step.oninput = () => { clearInterval(timer); show(+step.value); };
  $('play').onclick = () => { clearInterval(timer); let n = 1; show(n); timer = setInterval(() => n < scans ? show(++n) : clearInterval(timer), 700); };
  show(scans);
})();
