// Gives painted meshes the grain of their swatch: a picture that repeats, projected along the axes of the body.
// The server sends the pictures as invisible meshes /grain/SWATCH, and the size of a tile on each body with the state.
const NODE = /^\/body\/(\d+)\/-?\d+\/\d+-\d+-(\d+)$/;
const VERTEX = "varying vec3 grainPlace;", PLACE = "grainPlace = position;";
const FRAGMENT = `varying vec3 grainPlace;
uniform sampler2D grainPicture;
uniform float grainTile, grainGain;`;
const SHADE = `{
  vec3 side = pow(abs(normalize(cross(dFdx(grainPlace), dFdy(grainPlace)))), vec3(4.0)), at = grainPlace / grainTile;
  vec3 grain = side.x * texture2D(grainPicture, at.yz).rgb + side.y * texture2D(grainPicture, at.xz).rgb
    + side.z * texture2D(grainPicture, at.xy).rgb;
  diffuseColor.rgb *= grainGain * grain / (side.x + side.y + side.z);
}`;

function meshOf(node) {
  let found = null;
  node?.traverse((inner) => { if (inner.isMesh && !found) found = inner; });
  return found;
}

export function newGrain() {
  const known = new WeakMap();  // uniforms by material
  return ({ tiles = {}, gains = {} } = {}) => {
    const viewer = window.__viserMutable, nodes = viewer?.nodeRefFromName ?? {};
    let changed = false;
    for (const [name, node] of Object.entries(nodes)) {
      const [, body, swatch] = name.match(NODE) ?? [];
      const tile = tiles[body]?.[swatch], mesh = tile && meshOf(node), picture = mesh && meshOf(nodes[`/grain/${swatch}`])?.material.map;
      if (!picture) continue;
      const uniforms = known.get(mesh.material) ?? { grainPicture: {}, grainTile: {}, grainGain: {} };
      if (uniforms.grainPicture.value === picture && uniforms.grainTile.value === tile) continue;
      changed = true;
      uniforms.grainPicture.value = picture;
      uniforms.grainTile.value = tile;
      uniforms.grainGain.value = gains[swatch];
      if (!known.has(mesh.material)) patch(mesh.material, uniforms);
      known.set(mesh.material, uniforms);
    }
    if (changed) viewer.requestRender?.();
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
  material.customProgramCacheKey = () => "hapscene-grain";
  material.needsUpdate = true;
}
