// A tool pushes a weightless crate for two seconds; prints the momentum of the crate and the impulse that it received.
//     hapscene serve crate.stl --unit m --swatch wood
//     node push.mjs
import { Client } from "./hapscene_client.mjs";

const [mass, step, sleep] = [0.2, 1 / 60, (ms) => new Promise((done) => setTimeout(done, ms))];
const client = await Client.open({ port: Number(process.argv[2] ?? 47700) });
await client.order("free", { body: "crate", mass, inertia: [8e-5, 8e-5, 8e-5] });
client.frame(null, [{ name: "crate", p: [0, 0, 0], jumps: true }]);
await client.order("start", { p: [-0.03, 0, 0] });
await sleep(50);
client.take("crate");

let [x, v, received] = [0, 0, 0];
for (let k = 0; k < 120; k++) {
  client.frame([-0.03 + 0.05 * k * step, 0, 0], [{ name: "crate", p: [x, 0, 0], v: [v, 0, 0], w: [0, 0, 0] }]);
  await sleep(1000 * step);
  const grown = client.take("crate")[0];
  received += grown;
  v += grown / mass;
  x += v * step;
}
console.log(`momentum ${mass * v} received ${received}`);
for (const { tick, kind, body, swatch, speed } of client.events) console.log(`${tick}, ${kind}, ${body}, ${swatch}, ${speed}`);
client.close();
