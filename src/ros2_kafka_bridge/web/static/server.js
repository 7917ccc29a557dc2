// The server: the view as it changes, and requests.

const KEY = 'ros2-kafka-bridge-token';
const SILENT_MS = 6000;

export const token = () => sessionStorage.getItem(KEY);
export function keepToken(given) {
  if (given) sessionStorage.setItem(KEY, given);
  else sessionStorage.removeItem(KEY);
}

// Calls `onView` with the sections that changed, `onOpen` once the server has begun to tell them,
// `onGone` while it is away, and with its words where it has let this page go: too many look.
// Returns what asks anew at once, as with another token.
export function listen(onView, onOpen, onGone) {
  let stream = null; // the one that is open
  let later = null;
  let heard = 0;
  const open = async () => {
    clearTimeout(later);
    stream?.abort();
    const mine = stream = new AbortController();
    heard = performance.now();
    let [waitMs, full] = [1000, ''];
    try {
      const answer = await fetch('api/events', { headers: right(), cache: 'no-store', signal: mine.signal });
      if (answer.status === 401) keepToken(null); // it is no longer the token: look without
      if (!answer.ok) throw new Error(answer.statusText);
      onOpen();
      for await (const told of messages(answer.body)) {
        if (mine !== stream) return;
        heard = performance.now();
        waitMs = Number(told.retry ?? waitMs);
        if (told.event === 'full') full = JSON.parse(told.data).error;
        else if (told.data) onView(JSON.parse(told.data));
      }
    } catch { /* it is away, or was given up */ }
    if (mine !== stream) return;
    stream = null;
    onGone(full);
    wait(waitMs, full);
  };
  // A page that was let go and that nobody looks at does not come back to let another one go.
  const wait = (ms, full) => {
    later = setTimeout(() => (full && document.hidden ? wait(ms, full) : open()), ms);
  };
  // A server that was stopped in mid-stream (a laptop that slept) shows by its silence only.
  setInterval(() => {
    if (!stream || performance.now() - heard < SILENT_MS) return;
    onGone('');
    open();
  }, 1000);
  open();
  return open;
}

// The events of a stream, each as its fields. EventSource could not show the token.
async function* messages(body) {
  const reader = body.pipeThrough(new TextDecoderStream()).getReader();
  let [text, looked] = ['', 0];
  for (;;) {
    const { value, done } = await reader.read();
    if (done) return;
    text += value;
    for (let end = text.indexOf('\n\n', looked); end >= 0; end = text.indexOf('\n\n')) {
      yield Object.fromEntries(text.slice(0, end).split('\n').map((line) => line.split(/: ?(.*)/s, 2)));
      text = text.slice(end + 2);
    }
    looked = Math.max(0, text.length - 1);
  }
}

class Refused extends Error {
  constructor(text, status) {
    super(text);
    this.status = status;
  }
}

// Throws a Refused whose message is for people.
async function ask(path, options) {
  let answer;
  try {
    answer = await fetch(path, options);
  } catch {
    throw new Refused('The server of this page does not answer.', 0);
  }
  const content = await answer.json().catch(() => ({}));
  if (!answer.ok) throw new Refused(content.error ?? `Refused with status ${answer.status}.`, answer.status);
  return content;
}

const right = (given = token()) => (given ? { Authorization: `Bearer ${given}` } : {});

export const get = (path) => ask(path, { headers: right() });

export const post = (path, body = {}, given = token()) => ask(path, {
  method: 'POST',
  headers: { 'Content-Type': 'application/json', ...right(given) },
  body: JSON.stringify(body),
});
