// Draws a scene with WebGL, moves its camera, and finds the surface under a pixel. For the page of an exported scene and
// for that of `hapscene play`, which have a canvas "canvas".
//
// Positions are in the world frame of the scene, z up [m]; pixels are CSS pixels of the canvas.
"use strict";
const $ = (id) => document.getElementById(id);
const pressed = (button) => button.getAttribute("aria-pressed") === "true";
const press = (button, on) => button.setAttribute("aria-pressed", on);
const canvas = $("canvas"), gl = canvas.getContext("webgl2", { antialias: true, alpha: false });
const FOV = 0.6, NO_SURFACE = -1;  // field of view [rad]
const SHADOW_PX = 1024, GROUND_PX = 512;  // sizes of the shadow map and of the shadow on the ground
const LOOKS = 64, OPACITY = 0.75;  // swatches with a grain, and opacity of their colours over the colours of a mesh file
const narrow = matchMedia("(max-width: 760px)"), dark = matchMedia("(prefers-color-scheme: dark)");

// --- data: arrays are stored as [type, start, length] in one compressed block

async function unpack(text) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"))).arrayBuffer();
}
const TYPES = { u1: Uint8Array, i1: Int8Array, u2: Uint16Array, u4: Uint32Array, f4: Float32Array };
let block;
const array = ([type, start, length]) => new TYPES[type](block, start, length);

// --- drawing

const VERTEX = `#version 300 es
layout(location = 0) in vec3 position;  // 0 to 1 in the box of the scene
layout(location = 1) in vec2 octahedral;
layout(location = 2) in vec3 colour;
layout(location = 3) in uint swatch;
layout(location = 4) in vec2 uv;
layout(location = 5) in uint picture;  // 255 without
uniform mat4 view, light;
uniform vec3 low, size;
centroid out vec3 place, normal, base;  // not outside the triangle at its edges
centroid out vec4 shade;
out float depth;
flat out uint kind, layer;
out vec2 at;
void main() {
  at = uv;
  layer = picture;
  place = low + size * position;
  vec3 n = vec3(octahedral, 1.0 - abs(octahedral.x) - abs(octahedral.y));
  if (n.z < 0.0) n.xy = (1.0 - abs(n.yx)) * vec2(n.x < 0.0 ? -1.0 : 1.0, n.y < 0.0 ? -1.0 : 1.0);
  normal = normalize(n);
  base = pow(colour, vec3(2.2));
  kind = swatch;
  shade = light * vec4(place, 1.0);
  gl_Position = view * vec4(place, 1.0);
  depth = gl_Position.w;
}`;

// Share of sunlight at a point: mean of samples of the shadow map on a disc, turned by noise so that no bands appear.
const SHADOW = `
uniform sampler2DShadow shadows;
float lit(vec4 shade, float blur, int count) {
  vec3 at = shade.xyz * 0.5 + 0.5;
  float sum = 0.0, start = 6.28 * fract(52.98 * fract(dot(gl_FragCoord.xy, vec2(0.0671, 0.00584))));
  for (int i = 0; i < count; i++) {
    float turn = start + float(i) * 2.39996, far = sqrt((float(i) + 0.5) / float(count)) * blur;
    sum += texture(shadows, vec3(at.xy + far * vec2(cos(turn), sin(turn)), at.z - 0.003));
  }
  return sum / float(count);
}`;

const SURFACE = `#version 300 es
precision highp float;
precision highp sampler2DShadow;
centroid in vec3 place, normal, base;
centroid in vec4 shade;
flat in uint kind, layer;
in vec2 at;
uniform mediump sampler2DArray pictures;  // of the materials of mesh files
uniform vec3 eye, sun, background;
uniform int marked;
uniform mediump sampler2DArray grains;
uniform vec2 looks[64];  // of each swatch: repetitions of its grain per metre, gloss
uniform vec4 feels[64];  // colour of each swatch, and whether it is shown over the look of the body
uniform float over;  // opacity of the swatches over the look
out vec4 colour;
${SHADOW}
// Grain of the swatch, projected along the three axes: a normal tilted by the relief, and a brightness.
vec3 grain_at(vec2 at) { return (texture(grains, vec3(at, kind)).xyz * 255.0 - 128.0) / 127.0; }
vec4 grain(vec3 n) {
  vec3 at = place * looks[min(kind, 63u)].x, share = pow(abs(n), vec3(4.0));
  share /= share.x + share.y + share.z;
  vec3 x = grain_at(at.yz), y = grain_at(at.xz), z = grain_at(at.xy);
  vec3 slope = share.x * vec3(0.0, x.xy) + share.y * vec3(y.x, 0.0, y.y) + share.z * vec3(z.xy, 0.0);
  return vec4(normalize(n - slope + n * dot(n, slope)), 1.0 + dot(share, vec3(x.z, y.z, z.z)));
}
void main() {
  vec3 flat_n = normalize(gl_FrontFacing ? normal : -normal);
  vec4 grained = grain(flat_n);
  vec3 n = grained.xyz, to = normalize(eye - place), half_way = normalize(to + sun);
  float gloss = looks[min(kind, 63u)].y, sunlight = smoothstep(-0.15, 1.0, dot(n, sun)) * mix(0.1, 1.0, dot(flat_n, sun) > 0.0 ? lit(shade, 0.004, 6) : 0.0);
  vec3 sky = mix(vec3(0.36, 0.33, 0.31), vec3(0.50, 0.54, 0.60), 0.5 + 0.5 * n.z);
  float shine = pow(max(dot(n, half_way), 0.0), exp2(2.0 + 6.0 * gloss)) * gloss * 0.8 * sunlight, rim = pow(1.0 - max(dot(n, to), 0.0), 4.0) * 0.15 * gloss;
  vec4 feel = feels[min(kind, 63u)];
  vec3 own = texture(pictures, vec3(at, min(layer, 15u))).rgb;  // read for all pixels, since it needs derivatives
  vec3 light = mix(layer < 255u ? pow(own, vec3(2.2)) : base, feel.rgb * pow(grained.w, 2.2), over * feel.a) * (sky + 0.75 * sunlight * vec3(1.0, 0.96, 0.9)) + shine + rim * sky;
  if (marked >= 0 && int(kind) != marked) light = mix(light, background, 0.75);
  colour = vec4(pow(light / (1.0 + 0.12 * light), vec3(1.0 / 2.2)), 1.0);
}`;

// Surface under each pixel: distance along the view axis, and swatch + 1.
const PICK = `#version 300 es
precision highp float;
in float depth;
flat in uint kind;
out uvec4 found;
void main() { found = uvec4(floatBitsToUint(depth), kind + 1u, 0u, 0u); }`;

const NOTHING = `#version 300 es
precision highp float;
void main() {}`;

// Ground below the bodies: the soft shadow is drawn once, into a picture of the square around the scene.
const GROUND_VERTEX = `#version 300 es
uniform mat4 view, light;
uniform vec4 square;  // centre and half of the side
out vec2 place;
out vec4 shade;
void main() {
  place = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;
  vec4 world = vec4(square.xyz + square.w * vec3(place, 0.0), 1.0);
  shade = light * world;
  gl_Position = view == mat4(0.0) ? vec4(place, 0.0, 1.0) : view * world;
}`;
const GROUND_SHADOW = `#version 300 es
precision highp float;
precision highp sampler2DShadow;
in vec2 place;
in vec4 shade;
out vec4 colour;
${SHADOW}
void main() { colour = vec4(0.5 * (1.0 - smoothstep(0.5, 1.0, length(place))) * (1.0 - lit(shade, 0.014, 48))); }`;
const GROUND = `#version 300 es
precision mediump float;
in vec2 place;
uniform vec3 background;
uniform sampler2D ground;
out vec4 colour;
void main() { colour = vec4(pow(background * (1.0 - texture(ground, 0.5 + 0.5 * place).r), vec3(1.0 / 2.2)), 1.0); }`;

function program(vertex, fragment) {
  const made = gl.createProgram();
  for (const [type, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
  const at = {};
  for (let i = 0; i < gl.getProgramParameter(made, gl.ACTIVE_UNIFORMS); i++) {
    const { name } = gl.getActiveUniform(made, i);
    at[name] = gl.getUniformLocation(made, name);
  }
  return { made, at };
}

const add = (a, b, s = 1) => a.map((x, i) => x + s * b[i]);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => a.map((x) => x / Math.hypot(...a));

const SUN = unit([-0.45, -0.35, 0.82]);
let scene, middle, radius, opacity = () => OPACITY;  // `opacity`: that of the swatches over the colours of a mesh file
let pictures, draw_programs, faces, shadow_map, shadow_view, ground_map;

// Axes of a view towards −`back`: right, up and back.
function axes(back) {
  const right = unit(cross([0, 0, 1], back));
  return [right, cross(back, right), back];
}

// Orthographic view from the sun, with a depth map of the bodies.
function make_shadows() {
  const [right, up, back] = axes(SUN), reach = 1.6 * radius;
  const rows = [right, up, back.map((x) => -x)].map((axis) => [...axis.map((x) => x / reach), -dot(axis, middle) / reach]);
  shadow_view = [0, 1, 2, 3].flatMap((column) => [...rows.map((row) => row[column]), column === 3 ? 1 : 0]);
  shadow_map = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, shadow_map);
  gl.texStorage2D(gl.TEXTURE_2D, 1, gl.DEPTH_COMPONENT24, SHADOW_PX, SHADOW_PX);
  for (const [name, value] of [["MIN_FILTER", gl.LINEAR], ["MAG_FILTER", gl.LINEAR], ["WRAP_S", gl.CLAMP_TO_EDGE], ["WRAP_T", gl.CLAMP_TO_EDGE],
    ["COMPARE_MODE", gl.COMPARE_REF_TO_TEXTURE]]) gl.texParameteri(gl.TEXTURE_2D, gl[`TEXTURE_${name}`], value);
  const buffer = gl.createFramebuffer();
  gl.bindFramebuffer(gl.FRAMEBUFFER, buffer);
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, shadow_map, 0);
  gl.viewport(0, 0, SHADOW_PX, SHADOW_PX);
  gl.clear(gl.DEPTH_BUFFER_BIT);
  draw_bodies(draw_programs.nothing, shadow_view);
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, null, 0);
  ground_map = gl.createTexture();
  gl.activeTexture(gl.TEXTURE2);
  gl.bindTexture(gl.TEXTURE_2D, ground_map);
  gl.texStorage2D(gl.TEXTURE_2D, 1, gl.R8, GROUND_PX, GROUND_PX);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, ground_map, 0);
  gl.viewport(0, 0, GROUND_PX, GROUND_PX);
  draw_ground(draw_programs.ground_shadow, new Float32Array(16));
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
}

function draw_ground({ made, at }, view) {
  gl.useProgram(made);
  gl.uniformMatrix4fv(at.view, false, view);
  if (at.light) gl.uniformMatrix4fv(at.light, false, shadow_view);
  if (at.ground) gl.uniform1i(at.ground, 2);
  gl.uniform4f(at.square, middle[0], middle[1], scene.low[2] - 0.002 * radius, 2 * radius);
  gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
}

async function load_pictures() {
  pictures = await Promise.all(scene.pictures.map(async (src) => {
    const picture = Object.assign(new Image(), { src });
    await picture.decode().catch(() => {});  // a picture that is not decoded stays black
    return picture;
  }));
}

// A layer for each picture of a mesh file.
function make_pictures() {
  const { made, at } = draw_programs.surface, [{ width, height } = {}] = pictures;
  gl.useProgram(made);
  gl.uniform1i(at.pictures, 3);
  if (!width) return;
  gl.activeTexture(gl.TEXTURE3);
  gl.bindTexture(gl.TEXTURE_2D_ARRAY, gl.createTexture());
  gl.texStorage3D(gl.TEXTURE_2D_ARRAY, Math.floor(Math.log2(width)) + 1, gl.RGB8, width, height, pictures.length);
  pictures.forEach((picture, i) => gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, 0, 0, i, width, height, 1, gl.RGB, gl.UNSIGNED_BYTE, picture));
  gl.texParameteri(gl.TEXTURE_2D_ARRAY, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
  gl.generateMipmap(gl.TEXTURE_2D_ARRAY);
  gl.activeTexture(gl.TEXTURE0);
}

// A layer of slopes and brightness for each swatch.
function make_grains() {
  gl.activeTexture(gl.TEXTURE1);
  gl.bindTexture(gl.TEXTURE_2D_ARRAY, gl.createTexture());
  const count = Math.min(scene.swatches.length, LOOKS), px = Math.sqrt(scene.swatches[0].grain[2] / 3);
  gl.texStorage3D(gl.TEXTURE_2D_ARRAY, Math.floor(Math.log2(px)) + 1, gl.RGB8, px, px, count);
  for (let i = 0; i < count; i++) gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, 0, 0, i, px, px, 1, gl.RGB, gl.UNSIGNED_BYTE, array(scene.swatches[i].grain));
  gl.texParameteri(gl.TEXTURE_2D_ARRAY, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
  gl.generateMipmap(gl.TEXTURE_2D_ARRAY);
  const { made, at } = draw_programs.surface;
  gl.useProgram(made);
  gl.uniform1i(at.grains, 1);
  const shown = scene.swatches.slice(0, LOOKS), linear = (hex) => [1, 3, 5].map((i) => (parseInt(hex.slice(i, i + 2), 16) / 255) ** 2.2);
  gl.uniform2fv(at["looks[0]"], shown.flatMap(({ grain_m, gloss }) => [1 / grain_m, gloss]));
  gl.uniform4fv(at["feels[0]"], shown.flatMap(({ colour, plain }) => [...linear(colour), plain ? 0 : 1]));
  gl.activeTexture(gl.TEXTURE0);
}

function draw_bodies({ made, at }, view) {
  gl.useProgram(made);
  gl.uniformMatrix4fv(at.view, false, view);
  gl.uniform3fv(at.low, scene.low);
  gl.uniform3fv(at.size, scene.size);
  if (at.light) gl.uniformMatrix4fv(at.light, false, shadow_view);
  gl.drawElements(gl.TRIANGLES, faces, gl.UNSIGNED_INT, 0);
}

function set_up() {
  draw_programs = { surface: program(VERTEX, SURFACE), pick: program(VERTEX, PICK), nothing: program(VERTEX, NOTHING), ground_shadow: program(GROUND_VERTEX, GROUND_SHADOW), ground: program(GROUND_VERTEX, GROUND) };
  const columns = [["position", 3, gl.UNSIGNED_SHORT], ["normal", 2, gl.BYTE], ["colour", 3, gl.UNSIGNED_BYTE], ["swatch", 1, gl.UNSIGNED_SHORT], ["uv", 2, gl.FLOAT], ["picture", 1, gl.UNSIGNED_BYTE]];
  gl.vertexAttribI4ui(5, 255, 0, 0, 0);
  columns.forEach(([name, size, type], i) => {
    if (!scene[name][2]) return;
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, array(scene[name]), gl.STATIC_DRAW);
    gl.enableVertexAttribArray(i);
    if (name === "swatch" || name === "picture") gl.vertexAttribIPointer(i, size, type, 0, 0);
    else gl.vertexAttribPointer(i, size, type, true, 0, 0);
  });
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, array(scene.faces), gl.STATIC_DRAW);
  faces = scene.faces[2];
  gl.enable(gl.DEPTH_TEST);
  make_grains();
  make_pictures();
  make_shadows();
}

let marked = -1, waiting = false, picked = null;

function draw() {
  waiting = false;
  const scale = Math.min(devicePixelRatio, 2), { clientWidth, clientHeight } = canvas;
  const width = Math.round(clientWidth * scale), height = Math.round(clientHeight * scale);
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  const background = getComputedStyle(document.body).backgroundColor.match(/\d+/g).slice(0, 3).map((x) => (x / 255) ** 2.2);
  gl.viewport(0, 0, width, height);
  gl.clearColor(...background.map((x) => x ** (1 / 2.2)), 1);
  gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  const view = view_matrix(), { eye } = lens(), { surface, ground } = draw_programs;
  gl.useProgram(surface.made);
  gl.uniform3fv(surface.at.eye, eye);
  gl.uniform3fv(surface.at.sun, SUN);
  gl.uniform3fv(surface.at.background, background);
  gl.uniform1i(surface.at.marked, marked);
  gl.uniform1f(surface.at.over, opacity());
  draw_bodies(surface, view);
  if (camera.pitch > 0) {
    gl.useProgram(ground.made);
    gl.uniform3fv(ground.at.background, background);
    draw_ground(ground, view);
  }
  picked = null;
}
function redraw() {
  if (!waiting) requestAnimationFrame(draw);
  waiting = true;
}

// --- camera: it looks at a target from a distance

const START = { yaw: 0.41, pitch: 0.6 };  // view from the front, the right and above [rad]
const camera = { ...START, lowest: -1.5, margin_px: 92 };  // with the target and the distance; margin below the bodies

// Takes the box of a scene {low, size}, in which the camera moves; `set_up` takes the rest after `unpack`.
function take_scene(given) {
  scene = given;
  middle = scene.low.map((low, i) => low + scene.size[i] / 2);
  radius = Math.hypot(...scene.size) / 2;
  Object.assign(camera, { target: middle, distance: 4 * radius });
}

function lens() {
  const back = [Math.cos(camera.pitch) * Math.sin(camera.yaw), -Math.cos(camera.pitch) * Math.cos(camera.yaw), Math.sin(camera.pitch)];
  const [right, up] = axes(back), high = Math.tan(FOV / 2), wide = high * canvas.clientWidth / canvas.clientHeight;
  return { right, up, back, high, wide, eye: add(camera.target, back, camera.distance) };
}

function view_matrix() {
  const { right, up, back, high, wide, eye } = lens();
  const near = Math.max(camera.distance - 4 * radius, 0.01 * camera.distance), far = camera.distance + 8 * radius;
  const rows = [[right, 1 / wide, 0], [up, 1 / high, 0], [back, (near + far) / (near - far), 2 * near * far / (near - far)], [back, -1, 0]]
    .map(([axis, scale, more]) => [...axis.map((x) => x * scale), -dot(axis, eye) * scale + more]);
  return [0, 1, 2, 3].flatMap((column) => rows.map((row) => row[column]));
}

// Moves the camera so that a body, or the whole scene, fills the view.
function fit(body, quick = false) {
  const position = array(scene.position), corners = array(scene.faces);
  const { first, count } = body ?? { first: 0, count: faces }, step = Math.max(Math.floor(count / 6000), 1), points = [];
  for (let i = first; i < first + count; i += step)
    points.push([0, 1, 2].map((axis) => scene.low[axis] + scene.size[axis] * position[3 * corners[i] + axis] / 65535));
  const { right, up, back, high, wide } = lens(), sum = points.reduce((a, b) => add(a, b));
  const top = 0.92 * high, bottom = (1 - 2 * camera.margin_px / canvas.clientHeight) * high;  // above the button and the hint
  let target = sum.map((x) => x / points.length), distance = 0;
  for (let round = 0; round < 4; round++) {
    const seen = points.map((p) => { const q = add(p, target, -1); return [dot(q, right), dot(q, up), dot(q, back)]; });
    distance = Math.max(...seen.map(([x, y, z]) => Math.max(Math.abs(x) / (0.9 * wide), y / top, -y / bottom) + z));
    const [x, y] = [0, 1].map((axis) => seen.map((p) => p[axis] / (distance - p[2]))).map((all) => (Math.min(...all) + Math.max(...all)) / 2);
    target = add(add(target, right, x * distance), up, (y - (top - bottom) / 2) * distance);
  }
  glide({ target, distance }, quick);
}

let gliding = 0;
function glide(goal, quick) {
  const from = { ...camera }, start = performance.now(), run = ++gliding;
  const s = quick || matchMedia("(prefers-reduced-motion: reduce)").matches ? 0 : 300;
  const step = (now) => {
    if (run !== gliding) return;
    const part = s ? Math.min((now - start) / s, 1) : 1, ease = part * part * (3 - 2 * part);
    camera.distance = from.distance * (goal.distance / from.distance) ** ease;
    camera.target = add(from.target, add(goal.target, from.target, -1), ease);
    redraw();
    if (part < 1) requestAnimationFrame(step);
  };
  step(start);
}

function turn(dx, dy) {
  camera.yaw -= 0.008 * dx;
  camera.pitch = Math.min(Math.max(camera.pitch + 0.008 * dy, camera.lowest), 1.5);
  redraw();
}
function zoom(factor) {
  gliding++;
  camera.distance = Math.min(Math.max(camera.distance * factor, 0.05 * radius), 12 * radius);
  redraw();
}
function pan(dx, dy) {
  const { right, up, high } = lens(), each = 2 * high * camera.distance / canvas.clientHeight;
  camera.target = add(add(camera.target, right, -dx * each), up, dy * each);
  redraw();
}

// --- surface under the pointer: the picture of distances and swatches is read once for each camera

function pick() {
  const width = canvas.clientWidth, height = canvas.clientHeight, buffer = gl.createFramebuffer(), stores = [gl.RG32UI, gl.DEPTH_COMPONENT24].map((format) => {
    const store = gl.createRenderbuffer();
    gl.bindRenderbuffer(gl.RENDERBUFFER, store);
    gl.renderbufferStorage(gl.RENDERBUFFER, format, width, height);
    return store;
  });
  gl.bindFramebuffer(gl.FRAMEBUFFER, buffer);
  [gl.COLOR_ATTACHMENT0, gl.DEPTH_ATTACHMENT].forEach((point, i) => gl.framebufferRenderbuffer(gl.FRAMEBUFFER, point, gl.RENDERBUFFER, stores[i]));
  gl.viewport(0, 0, width, height);
  gl.clearBufferuiv(gl.COLOR, 0, [0, 0, 0, 0]);
  gl.clear(gl.DEPTH_BUFFER_BIT);
  draw_bodies(draw_programs.pick, view_matrix());
  const words = new Uint32Array(4 * width * height);
  gl.readPixels(0, 0, width, height, gl.RGBA_INTEGER, gl.UNSIGNED_INT, words);
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  gl.deleteFramebuffer(buffer);
  stores.forEach((store) => gl.deleteRenderbuffer(store));
  return { width, height, words, depths: new Float32Array(words.buffer), ...lens() };
}

// The swatch at a pixel, and the position there; NO_SURFACE beside the bodies.
function surface_at(x, y) {
  picked ??= pick();
  const { width, height, words, depths, right, up, back, high, wide, eye } = picked;
  const column = Math.floor(x), row = height - 1 - Math.floor(y), at = 4 * (row * width + column);
  if (column < 0 || row < 0 || column >= width || row >= height || words[at + 1] === 0) return { swatch: NO_SURFACE };
  const depth = depths[at], across = depth * wide * (2 * x / width - 1), along = depth * high * (1 - 2 * y / height);
  return { swatch: words[at + 1] - 1, place: add(add(add(eye, right, across), up, along), back, -depth), pixel: 2 * depth * high / height };
}
