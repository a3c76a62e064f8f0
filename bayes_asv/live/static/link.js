// The connection to the program: events from it, and controls sent to it.

// A growing set of curves over a common time axis.  The program sends the points from the first one
// on that was not final before, and these replace the points here from there on.
export class Curves {
  constructor(maxPoints) {
    this.maxPoints = maxPoints;
    this.base = 0;
    this.time = [];
    this.columns = [];
  }

  update(part) {
    if (part.fresh) {
      this.base = part.at;
      this.time = part.time;
      this.columns = part.columns;
      return;
    }
    const from = part.at - this.base;
    this.time.length = from;
    this.time.push(...part.time);
    this.columns.forEach((column, n) => {
      column.length = from;
      column.push(...part.columns[n]);
    });
    const surplus = this.time.length - this.maxPoints;
    if (surplus > this.maxPoints / 2) {
      this.time.splice(0, surplus);
      this.columns.forEach((column) => column.splice(0, surplus));
      this.base += surplus;
    }
  }
}

// Receives events for a window of so many seconds.  A hidden page disconnects, so that it does not
// count among the viewers.
export class Link {
  constructor(on) {
    this.on = on;
    this.window = 10;
    this.source = null;
    this.over = false;
    document.addEventListener("visibilitychange", () => this.open());
  }

  open(window = this.window) {
    this.window = window;
    this.source?.close();
    this.source = null;
    if (document.hidden || this.over) return;
    const source = new EventSource(`/events?window=${window}`);
    this.source = source;
    source.addEventListener("open", () => this.on.connected(true));
    source.addEventListener("error", () => {
      this.on.connected(false);
      // The browser reconnects by itself after a loss, but not after a refusal (too many pages).
      if (source.readyState === EventSource.CLOSED) setTimeout(() => this.open(), 3000);
    });
    source.addEventListener("scene", (event) => this.on.scene(JSON.parse(event.data)));
    source.addEventListener("frame", (event) => this.on.frame(JSON.parse(event.data)));
    source.addEventListener("end", () => {
      this.over = true;
      source.close();
      this.on.ended();
    });
  }
}

export async function send(action, value) {
  try {
    await fetch("/control", {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify({ do: action, value }),
    });
  } catch {
    // The event stream reports that the program has ended.
  }
}
