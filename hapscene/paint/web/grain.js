// Draws painted bodies with the grain of their swatches, and with a provisional stamp of the brush: see stamp.js.
// A grain is a picture that repeats, projected along the axes of the body. The server sends the pictures as invisible
// meshes /grain/SWATCH, and the size of a tile on each body with the state.
const NODE = /^\/body\/(\d+)\/-?\d+\/\d+-\d+-(\d+)$/;
export const POINTS = 32;  // points of a stamp
const VERTEX = "varying vec3 paintPlace;", PLACE = "paintPlace = position;";
const FRAGMENT = `varying vec3 paintPlace;
uniform sampler2D grainPicture;
uniform float grainTile, grainGain;
uniform vec4 stampPoint[${POINTS}];
uniform vec4 stampColour;
uniform int stampCount;
uniform float stampRadius;`;
const SHADE = `if (grainTile > 0.0) {
  vec3 side = pow(abs(normalize(cross(dFdx(paintPlace), dFdy(paintPlace)))), vec3(4.0)), at = paintPlace / grainTile;
  vec3 grain = side.x * texture2D(grainPicture, at.yz).rgb + side.y * texture2D(grainPicture, at.xz).rgb
    + side.z * texture2D(grainPicture, at.xy).rgb;
  diffuseColor.rgb *= grainGain * grain / (side.x + side.y + side.z);
}
for (int i = 0; i < stampCount; i++) {
  vec3 from = stampPoint[i - int(stampPoint[i].w)].xyz, way = stampPoint[i].xyz - from, off = paintPlace - from;
  float along = clamp(dot(off, way) / max(dot(way, way), 1e-20), 0.0, 1.0);
  if (length(off - along * way) < stampRadius) { diffuseColor.rgb = mix(diffuseColor.rgb, stampColour.rgb, stampColour.a); break; }
}`;

export function meshOf(node) {
  let found = null;
  node?.traverse((inner) => { if (inner.isMesh && !found) found = inner; });
  return found;
}

// The drawn meshes of bodies: [mesh, number of the body, swatch].
export function* bodyMeshes() {
  for (const [name, node] of Object.entries(window.__viserMutable?.nodeRefFromName ?? {})) {
    const [, body, swatch] = name.match(NODE) ?? [], mesh = body && meshOf(node);
    if (mesh) yield [mesh, body, swatch];
  }
}

// Returns a function to call before each frame, with the state of the grains and the uniforms of the stamp; it returns
// whether there are bodies.
export function newGrain() {
  const known = new WeakMap();  // uniforms by material
  return ({ tiles = {}, gains = {} } = {}, stamp) => {
    const viewer = window.__viserMutable;
    let drawn = false, changed = false;
    for (const [{ material }, body, swatch] of bodyMeshes()) {
      drawn = true;
      let uniforms = known.get(material);
      if (!uniforms) {
        uniforms = { grainPicture: { value: null }, grainTile: { value: 0 }, grainGain: { value: 1 }, ...stamp(body) };
        known.set(material, uniforms);
        patch(material, uniforms);
        changed = true;
      }
      const picture = tiles[body]?.[swatch] ? meshOf(viewer.nodeRefFromName[`/grain/${swatch}`])?.material.map ?? null : null;
      const tile = picture ? tiles[body][swatch] : 0;
      if (uniforms.grainPicture.value === picture && uniforms.grainTile.value === tile) continue;
      changed = true;
      uniforms.grainPicture.value = picture;
      uniforms.grainTile.value = tile;
      uniforms.grainGain.value = gains[swatch] ?? 1;
    }
    if (changed) viewer.requestRender?.();
    return drawn;
  };
}

function patch(material, uniforms) {
  material.onBeforeCompile = (shader) => {
    Object.assign(shader.uniforms, uniforms);
    shader.vertexShader = shader.vertexShader.replace("#include <common>", `#include <common>\n${VERTEX}`)
      .replace("#include <begin_vertex>", `#include <begin_vertex>\n${PLACE}`);
    shader.fragmentShader = shader.fragmentShader.replace("#include <common>", `#include <common>\n${FRAGMENT}`)
      .replace("#include <color_fragment>", `#include <color_fragment>\n${SHADE}`);
  };
  material.customProgramCacheKey = () => "hapscene-paint";
  material.needsUpdate = true;
}
