// Our socket, in a worker: what is heard must not wait for the page's drawing.
"use strict";

// Passes on to the page what the server says; accelerations go straight to the ear besides.
function listen() {
  let socket = null, ear = null, count = 0;
  function connect(url) {
    socket = new WebSocket(url);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => postMessage({ open: true });
    socket.onclose = () => { postMessage({ open: false }); setTimeout(connect, 1000, url); };
    socket.onmessage = ({ data }) => {
      if (typeof data === "string") { postMessage({ text: data }); return; }
      const came = { count: ++count, at_ms: performance.timeOrigin + performance.now() };
      if (ear && new Float32Array(data, 0, 1)[0] === 1) {
        const [, tick_s, n, block] = new Float32Array(data, 0, 4);
        ear.postMessage({ a: new Float32Array(data, 16 + 4 * n, n * block), rate: block / tick_s, count });
      }
      postMessage({ buffer: data, came }, [data]);
    };
  }
  onmessage = ({ data }) => {
    if (data.url) connect(data.url);
    else if (data.ear) ear = data.ear;
    else if (socket && socket.readyState === 1) socket.send(data.text);
  };
}

listen();
