// Shows the brush's paint at once, as a provisional stamp that the painted faces of the server replace.
import { POINTS, bodyMeshes } from "/hapscene-grain.js";

const REPLACED_MS = 500;  // time in which the painted faces arrive after the server has painted them

// First point of the surface under a place on the canvas, in the frame of its body [m]; null without a hit.
function pick({ x, y }) {
  const { camera } = window.__viserMutable, eye = camera.position.clone().setFromMatrixPosition(camera.matrixWorld);
  const far = eye.clone().set(2 * x - 1, 1 - 2 * y, 0.5).unproject(camera);
  let best = null;
  for (const [mesh, body] of bodyMeshes()) {
    const toBody = mesh.matrixWorld.clone().invert();
    const o = eye.clone().applyMatrix4(toBody), d = far.clone().applyMatrix4(toBody).sub(o);
    const { center, radius } = mesh.geometry.boundingSphere, off = center.clone().sub(o);
    if (off.lengthSq() - off.dot(d) ** 2 / d.lengthSq() > radius ** 2) continue;
    const t = firstHit(mesh.geometry, o, d, mesh.material.side === 0, best?.t ?? Infinity);
    if (t !== null) best = { t, body, hidden: !shown(mesh), p_m: d.multiplyScalar(t).add(o) };
  }
  return best?.hidden ? null : best;
}
const shown = (node) => node.visible && (!node.parent || shown(node.parent));

// Parameter of the first hit of a ray with the triangles of a geometry, below `most`; null without a hit.
function firstHit({ index, attributes: { position } }, o, d, fronts, most) {
  const p = position.array, corners = index.array;
  let best = null;
  for (let i = 0; i < corners.length; i += 3) {
    const a = 3 * corners[i], b = 3 * corners[i + 1], c = 3 * corners[i + 2];
    const ux = p[b] - p[a], uy = p[b + 1] - p[a + 1], uz = p[b + 2] - p[a + 2];
    const vx = p[c] - p[a], vy = p[c + 1] - p[a + 1], vz = p[c + 2] - p[a + 2];
    const nx = uy * vz - uz * vy, ny = uz * vx - ux * vz, nz = ux * vy - uy * vx;
    const across = nx * d.x + ny * d.y + nz * d.z;
    if (across === 0 || (fronts && across > 0)) continue;
    const sx = o.x - p[a], sy = o.y - p[a + 1], sz = o.z - p[a + 2];
    const t = -(nx * sx + ny * sy + nz * sz) / across;
    if (t <= 0 || t >= most) continue;
    const qx = d.y * sz - d.z * sy, qy = d.z * sx - d.x * sz, qz = d.x * sy - d.y * sx;
    const v = (qx * vx + qy * vy + qz * vz) / across, w = -(qx * ux + qy * uy + qz * uz) / across;
    if (v >= 0 && w >= 0 && v + w <= 1) most = best = t;
  }
  return best;
}

export function newStamp() {
  const points = { value: new Float32Array(4 * POINTS) }, colour = { value: [0, 0, 0, 0] }, radius = { value: 0 };
  const counts = {};  // by body
  const count = (body) => (counts[body] ??= { value: 0 });
  let on = null, timer = null;
  const stamp = {
    enabled: true,
    uniforms: (body) => ({ stampPoint: points, stampColour: colour, stampRadius: radius, stampCount: count(body) }),
    // Adds a point, with the state of the page; its `brush`, radius [m] and opacity, is null for tools without a stamp.
    add(place, { brush, colour: chosen }, begins) {
      const hit = brush && stamp.enabled ? pick(place) : null;
      clearTimeout(timer);
      if (!hit) { stamp.lifted = true; return; }
      if (hit.body !== on || radius.value !== brush.radius_m) stamp.clear();
      on = hit.body;
      const n = count(on), joined = n.value > 0 && !begins && !stamp.lifted;
      stamp.lifted = false;
      if (n.value === POINTS) points.value.copyWithin(0, 4); else n.value += 1;
      points.value.set([...hit.p_m, joined ? 1 : 0], 4 * (n.value - 1));
      points.value[3] = 0;
      const material = bodyMeshes().next().value[0].material;
      colour.value = [...material.color.clone().set(chosen), brush.opacity];
      radius.value = brush.radius_m;
      window.__viserMutable.requestRender();
    },
    clear() {  // visible in the next frame, which comes within a second
      clearTimeout(timer);
      if (on !== null) count(on).value = 0;
    },
    clearSoon() { clearTimeout(timer); timer = setTimeout(stamp.clear, REPLACED_MS); },
  };
  return stamp;
}
