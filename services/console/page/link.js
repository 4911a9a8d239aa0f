// The page's end of the WebSocket: questions with answers, frames as they come.
"use strict";
const Link = (() => {
  let socket = null, next = 1, wait = 300;
  const open = new Map(), listeners = { frame: [], greeting: [], up: [], down: [] };
  const on = (what, listener) => listeners[what].push(listener);
  const tell = (what, value) => listeners[what].forEach((listener) => listener(value));
  // The token comes behind the # of the address, so that it is in no request and no log.
  const shown = new URLSearchParams(location.hash.slice(1)).get("token");
  if (shown) {
    sessionStorage.setItem("token", shown);
    history.replaceState(null, "", location.pathname);
  }
  function connect() {
    socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/socket`);
    socket.onopen = () => { wait = 300; tell("up"); };
    socket.onmessage = (message) => {
      const value = JSON.parse(message.data);
      if (value.frame) return tell("frame", value.frame);
      if (value.greeting) return tell("greeting", value.greeting);
      const asked = open.get(value.id);
      if (asked) { open.delete(value.id); asked(value); }
    };
    socket.onclose = () => {
      open.forEach((answer) => answer({ error: "the console is not there" }));
      open.clear();
      tell("down");
      setTimeout(connect, wait);
      wait = Math.min(2 * wait, 5000);
    };
  }
  // Answers with {error} where it cannot be done; never throws.
  function ask(kind, what = {}) {
    if (!socket || socket.readyState !== WebSocket.OPEN) return Promise.resolve({ error: "the console is not there" });
    const id = next++;
    return new Promise((answer) => {
      open.set(id, answer);
      socket.send(JSON.stringify({ id, want: { [kind]: what } }));
    });
  }
  return { on, ask, connect, token: () => sessionStorage.getItem("token") };
})();
