// Worker that owns the WebSocket, so that sound does not wait for drawing. It passes messages to the page, and
// accelerations also directly to the audio monitor.
"use strict";

function listen() {
  let socket = null, monitor = null, count = 0;
  function connect(url) {
    socket = new WebSocket(url);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => postMessage({ open: true });
    socket.onclose = () => { postMessage({ open: false }); setTimeout(connect, 1000, url); };
    socket.onmessage = ({ data }) => {
      if (typeof data === "string") { postMessage({ text: data }); return; }
      const received = { count: ++count, at_ms: performance.timeOrigin + performance.now() };
      let played = null;
      if (new Float32Array(data, 0, 1)[0] === 1) {
        const [, tick_s, n, block, first, last] = new Float32Array(data, 0, 6);
        const a = new Float32Array(data, 24 + 4 * n, n * block);
        played = a.map((v, i) => v * (first + (last - first) * i / a.length));
        if (monitor) monitor.postMessage({ a: played, rate: block / tick_s, count });
      }
      postMessage({ buffer: data, received, played }, [data]);
    };
  }
  onmessage = ({ data }) => {
    if (data.url) connect(data.url);
    else if (data.monitor) monitor = data.monitor;
    else if (socket && socket.readyState === 1) socket.send(data.text);
  };
}

listen();
