// Stick figures: joints in millimetres, z up, frame after frame; dragging turns the view of all of them.
"use strict";
(() => {
  const SIZE = 184, SPAN = 2.3, TILT = 0.22, TILE = 0.5;
  const figures = [...document.querySelectorAll("canvas")].map((canvas) => {
    const bytes = Uint8Array.from(atob(canvas.dataset.joints), (c) => c.charCodeAt(0));
    const joints = new Int16Array(bytes.buffer);
    const scale = window.devicePixelRatio || 1;
    canvas.width = canvas.height = SIZE * scale;
    const pen = canvas.getContext("2d");
    pen.scale(scale, scale);
    return { canvas, pen, joints, frames: joints.length / (3 * PARENTS.length), seen: true };
  });
  const watch = new IntersectionObserver((entries) => entries.forEach((entry) => {
    figures.find((f) => f.canvas === entry.target).seen = entry.isIntersecting;
  }));
  figures.forEach((f) => watch.observe(f.canvas));

  let yaw = 0.7, playing = !matchMedia("(prefers-reduced-motion: reduce)").matches, time = 0, before = null;

  function draw(figure) {
    const { pen, joints } = figure;
    // A second of rest on the last frame tells where a clip ends.
    const frame = Math.min(Math.floor(time * FPS) % (figure.frames + FPS), figure.frames - 1);
    const at = (j, k) => joints[(frame * PARENTS.length + j) * 3 + k] / 1000;
    const cx = at(0, 0), cy = at(0, 1), px = SIZE / SPAN;
    const place = (x, y, z) => {
      const dx = x - cx, dy = y - cy;
      const right = dx * Math.sin(yaw) - dy * Math.cos(yaw), away = dx * Math.cos(yaw) + dy * Math.sin(yaw);
      return [SIZE / 2 - right * px, SIZE * 0.86 - (z * Math.cos(TILT) - away * Math.sin(TILT)) * px];
    };
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => style.getPropertyValue(name);
    const line = (a, b) => { pen.beginPath(); pen.moveTo(...a); pen.lineTo(...b); pen.stroke(); };
    pen.clearRect(0, 0, SIZE, SIZE);
    pen.lineWidth = 1;
    pen.strokeStyle = colour("--line");
    const x0 = Math.round(cx / TILE) * TILE, y0 = Math.round(cy / TILE) * TILE;
    for (let i = -2; i <= 2; i++) {
      line(place(x0 + i * TILE, y0 - 1, 0), place(x0 + i * TILE, y0 + 1, 0));
      line(place(x0 - 1, y0 + i * TILE, 0), place(x0 + 1, y0 + i * TILE, 0));
    }
    pen.lineCap = "round";
    pen.lineWidth = 3.5;
    for (let j = 1; j < PARENTS.length; j++) {
      pen.strokeStyle = colour({ l: "--left", r: "--right" }[SIDES[j]] || "--ink");
      line(place(at(j, 0), at(j, 1), at(j, 2)), place(at(PARENTS[j], 0), at(PARENTS[j], 1), at(PARENTS[j], 2)));
    }
    pen.fillStyle = colour("--ink");
    pen.beginPath();
    const [hx, hy] = place(at(HEAD, 0), at(HEAD, 1), at(HEAD, 2) + 0.08);
    pen.arc(hx, hy, 0.1 * px, 0, 2 * Math.PI);
    pen.fill();
  }

  function tick(now) {
    if (before !== null && playing) time += Math.min(now - before, 200) / 1000;
    before = now;
    figures.filter((f) => f.seen).forEach(draw);
    requestAnimationFrame(tick);
  }

  let grabbed = null;
  document.addEventListener("pointerdown", (e) => { if (e.target.tagName === "CANVAS") grabbed = e.clientX; });
  document.addEventListener("pointerup", () => { grabbed = null; });
  document.addEventListener("pointermove", (e) => {
    if (grabbed === null) return;
    yaw -= (e.clientX - grabbed) / 80;
    grabbed = e.clientX;
  });
  const button = document.querySelector("button");
  const name = () => { button.textContent = playing ? "Pause" : "Play"; };
  button.addEventListener("click", () => { playing = !playing; name(); });
  name();
  requestAnimationFrame(tick);
})();
