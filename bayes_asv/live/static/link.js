// The line to the program: what it says, and what is asked of it.

// A growing set of curves over one axis of time.  The program sends the points from the first one
// on that was not final before, so what is here from there on is replaced.
export class Curves {
  constructor(most) {
    this.most = most;
    this.base = 0;
    this.time = [];
    this.columns = [];
  }

  take(part) {
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
    const surplus = this.time.length - this.most;
    if (surplus > this.most / 2) {
      this.time.splice(0, surplus);
      this.columns.forEach((column) => column.splice(0, surplus));
      this.base += surplus;
    }
  }
}

// Listen with a window of so many seconds.  A page that nobody sees does not listen: it would only
// take the place of one that somebody does.
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
      // A line that was cut is taken up again by the browser; a refusal (too many pages) is not.
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

export async function ask(action, value) {
  try {
    await fetch("/control", {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify({ do: action, value }),
    });
  } catch {
    // The stream says that the program is gone.
  }
}
