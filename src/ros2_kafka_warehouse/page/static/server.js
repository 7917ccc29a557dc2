// The server: the view as it changes, and requests.

// Calls `onView` with the sections that changed, `onGone` while the server is away.
export function listen(onView, onGone) {
  let source;
  let heard = performance.now();
  const open = () => {
    source = new EventSource('api/events');
    source.onmessage = (event) => {
      heard = performance.now();
      onView(JSON.parse(event.data));
    };
    source.onerror = () => {
      onGone();
      // After an answer that is no stream, a browser does not try again by itself.
      if (source.readyState === EventSource.CLOSED) setTimeout(open, 2000);
    };
  };
  open();
  // A server that was stopped in mid-stream (a laptop that slept) shows by its silence only.
  setInterval(() => {
    if (performance.now() - heard < 6000) return;
    heard = performance.now();
    onGone();
    source.close();
    open();
  }, 1000);
}

export async function getSite() {
  for (;;) {
    try {
      const answer = await fetch('api/site');
      if (answer.ok) return await answer.json();
    } catch { /* the server is away: asked again */ }
    await new Promise((resolve) => setTimeout(resolve, 1000));
  }
}

// Throws an Error whose message is for people.
export async function post(path, body) {
  let answer;
  try {
    answer = await fetch(path, {
      method: 'POST',
      headers: { 'Content-Type': 'application/json' },
      body: JSON.stringify(body),
    });
  } catch {
    throw new Error('The page’s server does not answer.');
  }
  const content = await answer.json().catch(() => ({}));
  if (!answer.ok) throw new Error(content.error ?? `Refused with status ${answer.status}.`);
  return content;
}
