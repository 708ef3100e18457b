// The interactive twin. Asks ematwin.exploring.explorer through an anywidget model: that of a notebook,
// or that of page.js. uPlot stands above this text.

const STEPS = 1000; // of a slider
const FONT = "12px system-ui, sans-serif";

class Explorer {
  constructor(model, root) {
    this.model = model;
    this.root = root;
    this.waiting = new Map(); // questions by their ids
    this.name = Math.random().toString(36).slice(2); // several views of a widget share its messages
    this.number = 0;
    this.plots = [];
    this.hear = (message) => this.heard(message);
    model.on("msg:custom", this.hear);
    this.dark = matchMedia("(prefers-color-scheme: dark)");
    this.repaint = () => this.draw();
    this.dark.addEventListener("change", this.repaint);
    this.sized = new ResizeObserver(() => this.resize());
  }

  close() {
    this.model.off("msg:custom", this.hear);
    this.dark.removeEventListener("change", this.repaint);
    this.sized.disconnect();
    this.clear();
  }

  clear() {
    this.plots.forEach((plot) => plot.destroy());
    this.plots = [];
    this.parts?.figures.replaceChildren();
  }

  // Questions: one answer each, in any order

  ask(question) {
    const id = `${this.name}-${++this.number}`;
    return new Promise((resolve, reject) => {
      this.waiting.set(id, { resolve, reject });
      this.model.send({ id, ...question });
    });
  }

  heard({ id, answer }) {
    const one = this.waiting.get(id);
    if (!one) return; // asked by another view
    this.waiting.delete(id);
    if (answer.error) one.reject(new Error(answer.error));
    else one.resolve(answer);
  }

  async open() {
    try {
      await this.take(await this.ask({ ask: "setup" }));
    } catch (error) {
      this.root.replaceChildren(make("p", { class: "ee-status ee-error" }, error.message));
    }
  }

  async take(setup) {
    this.setup = setup;
    this.along = setup.sliders[0].name;
    this.channel = setup.channels[0].name;
    this.fitted = false;
    this.intervals = {};
    this.values = Object.fromEntries(setup.sliders.map((one) => [one.name, one.healthy]));
    this.build();
    await this.turnTo(this.channel);
  }

  async turnTo(channel) {
    this.channel = channel;
    this.traces = this.setup.channels.find((one) => one.name === channel);
    this.profile = null;
    await this.follow();
    this.draw();
  }

  // The twin follows the sliders: one question under way at most, and always one after the last move

  async follow() {
    this.moved = true;
    if (this.following) return this.following;
    this.following = this.catchUp().finally(() => { this.following = null; });
    return this.following;
  }

  async catchUp() {
    while (this.moved) {
      this.moved = false;
      const { values, channel, along, fitted } = this;
      const key = this.others(); // now: sliders move on while an answer is awaited
      try {
        this.answer = await this.ask({ ask: "answer", values, channel, fitted });
        this.tell();
        this.paint();
        if (this.profile?.key !== key) {
          const profile = await this.ask({ ask: "profile", values, along, fitted });
          this.profile = { ...profile, key };
          this.paint();
        }
        this.say("");
      } catch (error) {
        this.say(error.message, true);
        return;
      }
    }
  }

  // What a profile depends on: all values but that of its own slider.
  others() {
    return JSON.stringify([this.along, this.fitted, { ...this.values, [this.along]: 0 }]);
  }

  move(name, value) {
    this.values = { ...this.values, [name]: value };
    this.along = name;
    this.follow();
  }

  // Simulations of a search under way, until it ends. A notebook answers only then.
  async watch() {
    const { progress } = this.parts;
    const searching = () => this.acting === "verdict";
    while (searching()) {
      await new Promise((wake) => setTimeout(wake, 200));
      const { evaluations, most } = searching() ? await this.ask({ ask: "progress" }) : {};
      if (!most || !searching()) continue;
      progress.max = most;
      progress.value = evaluations;
      progress.hidden = false;
      this.say(`Identifying: ${evaluations} simulations of at most ${most} …`);
    }
    progress.hidden = true;
  }

  async act(what, button) {
    this.busy(true, what);
    if (what === "verdict") this.watch().catch(() => {}); // what went wrong, the verdict says
    const { values, fitted } = this;
    const began = performance.now();
    try {
      if (what === "fit") {
        const found = await this.ask({ ask: "fit", values, fitted });
        this.values = { ...values, ...found.values };
        await this.follow();
        const seconds = ((performance.now() - began) / 1000).toFixed(1);
        this.say(`Fitted: ${found.evaluations} simulations in ${seconds} s.`);
      } else {
        const found = await this.ask({ ask: "verdict" });
        this.values = { ...this.healthy(), ...found.values };
        this.intervals = found.intervals;
        this.fitted = found.fitted;
        this.judge(found);
        await this.follow();
      }
    } catch (error) {
      this.say(error.message, true);
    }
    this.busy(false);
    this.place();
    button.focus({ preventScroll: true });
  }

  healthy() {
    return Object.fromEntries(this.setup.sliders.map((one) => [one.name, one.healthy]));
  }

  // The page

  build() {
    const { setup } = this;
    this.clear();
    this.rows = new Map();
    const faults = setup.sliders.filter((one) => one.fault);
    const rest = setup.sliders.filter((one) => !one.fault);
    this.parts = {
      misfit: make("strong", {}, "–"),
      status: make("p", { class: "ee-status", role: "status" }),
      progress: make("progress", { class: "ee-progress", hidden: "", "aria-label": "Search" }),
      verdict: make("div", { class: "ee-verdict", hidden: "" }),
      fitted: make("input", { type: "checkbox" }),
      figures: make("div", { class: "ee-figures" }),
    };
    const { parts } = this;
    parts.withFitted = make("label", { class: "ee-check", hidden: "" }, parts.fitted,
      "parameters, load and sensors as the verdict found them");
    parts.fitted.addEventListener("change", () => {
      this.fitted = parts.fitted.checked;
      this.follow();
    });
    const buttons = [];
    const button = (text, title, act) => {
      const one = make("button", { type: "button", title }, text);
      one.addEventListener("click", () => act(one));
      buttons.push(one);
    };
    if (setup.recorded) {
      button("Fit", "Descend from where the sliders stand", (one) => this.act("fit", one));
      button("Verdict", "Identify: search everywhere, with intervals", (one) => this.act("verdict", one));
    }
    button("Healthy", "All sliders back to healthy", () => this.reset());
    parts.buttons = buttons;
    const choices = [];
    if (setup.scenarios.length > 1) {
      choices.push(this.choice("Scenario", setup.scenarios.map((name) => [name, name]),
        setup.scenario, (name) => this.ask({ ask: "scenario", name }).then((one) => this.take(one))));
    }
    if (setup.channels.length > 1) {
      choices.push(this.choice("Channel", setup.channels.map((one) => [one.name, one.title]),
        this.channel, (name) => this.turnTo(name)));
    }
    const body = make("div", { class: "ee-body" },
      make("header", {},
        make("div", { class: "ee-what" },
          make("h1", {}, setup.title),
          make("p", { class: "ee-source" }, setup.source)),
        make("div", { class: "ee-misfit" }, parts.misfit,
          make("span", {}, setup.recorded ? "of the recording unexplained" : "departure from healthy"),
          parts.before = make("span", { class: "ee-before" })),
        make("div", { class: "ee-buttons" }, ...buttons)),
      parts.verdict,
      parts.figures,
      make("section", { class: "ee-sliders", "aria-label": "Unknowns" },
        ...choices,
        ...faults.map((one) => this.slider(one)),
        parts.withFitted,
        rest.length ? make("details", {}, make("summary", {}, "Load and sensors"),
          ...rest.map((one) => this.slider(one))) : "",
        parts.status, parts.progress,
        ...setup.warnings.map((text) => make("p", { class: "ee-warning" }, text))));
    this.root.replaceChildren(make("div", { class: "ematwin-explore" }, body));
    for (const [name, color] of Object.entries(setup.colors)) {
      body.style.setProperty(`--ee-${name}`, color);
    }
    this.body = body;
    this.sized.disconnect();
    this.sized.observe(body);
    this.place();
  }

  choice(text, options, chosen, act) {
    const select = make("select", {}, ...options.map(([value, title]) => make("option", { value }, title)));
    select.value = chosen;
    select.addEventListener("change", () => act(select.value).catch((error) => this.say(error.message, true)));
    return make("label", { class: "ee-choice" }, text, select);
  }

  slider(one) {
    const input = make("input", { type: "range", min: 0, max: STEPS, step: 1, "data-name": one.name });
    const said = make("output", {});
    const band = make("span", { class: "ee-band", hidden: "" });
    const mark = (kind, value, title) =>
      value === null ? "" : at(make("span", { class: `ee-mark ee-${kind}`, title }), share(one, value));
    input.addEventListener("input", () => this.move(one.name, value(one, input.value / STEPS)));
    input.addEventListener("focus", () => { this.along = one.name; this.follow(); });
    this.rows.set(one.name, { one, input, said, band });
    return make("label", { class: "ee-row", title: one.meaning },
      make("span", { class: "ee-name" }, one.title), said,
      make("span", { class: "ee-track" }, band, mark("healthy", one.healthy, "healthy"),
        mark("truth", one.truth, "injected"), input),
      make("span", { class: "ee-ends" }, make("span", {}, one.ends[0]), make("span", {}, one.ends[1])));
  }

  reset() {
    this.values = this.healthy();
    this.fitted = false;
    this.intervals = {};
    this.parts.verdict.hidden = true;
    this.parts.withFitted.hidden = true;
    this.place();
    this.follow();
  }

  judge(found) {
    const { verdict, withFitted, fitted } = this.parts;
    const { grade, sentence } = found.verdict;
    verdict.className = `ee-verdict ee-${grade}`;
    verdict.replaceChildren(make("strong", {}, sentence),
      ...found.warnings.map((text) => make("p", {}, text)));
    verdict.hidden = false;
    withFitted.hidden = !found.fitted;
    fitted.checked = found.fitted;
    this.say(`${found.evaluations} simulations in ${found.seconds.toFixed(1)} s.`);
  }

  // Sliders to where the values are.
  place() {
    for (const { one, input, band } of this.rows.values()) {
      input.value = Math.round(STEPS * share(one, this.values[one.name]));
      const ends = this.intervals[one.name];
      band.hidden = !ends;
      if (!ends) continue;
      const [low, high] = ends.map((end) => Math.min(Math.max(share(one, end), 0), 1));
      at(band, low).style.setProperty("--ee-width", high - low);
    }
  }

  // What the twin answered, in words.
  tell() {
    const { answer, parts } = this;
    parts.misfit.textContent = percent(answer.misfit);
    parts.before.textContent = this.setup.recorded ? `healthy twin ${percent(this.setup.healthy_misfit)}` : "";
    for (const [name, { input, said }] of this.rows) {
      said.textContent = answer.said[name];
      input.setAttribute("aria-valuetext", answer.said[name]);
    }
  }

  say(text, wrong = false) {
    const { status } = this.parts;
    if (!text && this.acting) return;
    status.textContent = text;
    status.classList.toggle("ee-error", wrong);
  }

  busy(on, what) {
    this.acting = on && what;
    this.root.toggleAttribute("aria-busy", on);
    this.parts.buttons.forEach((one) => { one.disabled = on; });
    this.rows.forEach(({ input }) => { input.disabled = on; });
    if (on) {
      this.say(what === "fit" ? "Descending …" : "Identifying: this takes some seconds …");
    }
  }

  // The figures

  draw() {
    if (!this.answer) return;
    this.clear();
    const { setup } = this;
    const seen = setup.recorded ? [["recorded", "recorded"]] : [];
    const time = { cursor: { sync: { key: this.name }, drag: { x: true, y: false } } };
    this.figure("answer", this.traces.title, this.traces.unit, 240, time,
      [["healthy", "healthy", [2, 4]], ...seen, ["twin", "twin"]]);
    this.figure("residual", setup.recorded ? "Recording less twin" : "Healthy less twin",
      this.traces.unit, 140, { ...time, label: "time, s", range: () => this.span() }, [["recorded", "residual"]]);
    this.figure("profile", "Misfit", "%", 190, { label: " ", marks: true }, [["twin", "misfit"]]);
    setup.inputs.forEach((one, n) => this.figure("input", one.title, one.unit, 110,
      { ...time, label: n + 1 < setup.inputs.length ? "" : "time, s" }, [["input", one.title]])
      .setData([setup.time, one.values]));
    this.paint();
  }

  // A figure: heading, legend of the lines [tone, label, dash], and a plot that `paint` fills.
  figure(name, title, unit, height, { label = "", cursor, range, marks }, lines) {
    const heading = make("h2", {}, title, unit ? make("small", {}, ` ${unit}`) : "");
    const place = make("div", { class: "ee-plot" });
    const truth = this.setup.sliders.some((one) => one.truth !== null) ? [["truth", "injected"]] : [];
    const told = marks ? [["twin", "here"], ["healthy", "healthy"], ...truth] : lines;
    const legend = told.length > 1 ? make("p", { class: "ee-legend" }, ...told.map(([tone, text]) =>
      make("span", { style: `--ee-tone: var(--ee-${tone})` }, text))) : "";
    this.parts.figures.append(
      make("section", { class: `ee-figure ee-${name}` }, heading, legend, place));
    const color = (tone) => getComputedStyle(this.body).getPropertyValue(`--ee-${tone}`).trim();
    const rule = { stroke: color("grid"), width: 1 };
    const axis = { stroke: color("text"), grid: rule, ticks: rule, font: FONT };
    const below = label ? { label, labelSize: 16, labelFont: FONT } : {};
    const plot = new uPlot({
      width: Math.max(place.clientWidth, 200), height, legend: { show: false }, cursor,
      scales: { x: { time: false }, y: range ? { range } : {} },
      axes: [{ ...axis, ...below, size: 28 }, { ...axis, size: 56, space: 24 }],
      series: [{}, ...lines.map(([tone, text, dash]) => ({
        label: text, stroke: color(tone), width: tone === "twin" ? 2 : 1.4, dash, points: { show: false },
      }))],
      hooks: marks ? { draw: [(one) => this.mark(one, color)] } : {},
    }, [[], ...lines.map(() => [])], place);
    this.plots.push(Object.assign(plot, { figure: name, heading }));
    return plot;
  }

  // Residuals on the scale of the healthy twin's, so that a flat line is a good fit.
  span() {
    const largest = (trace) => trace.reduce((most, x) => Math.max(most, Math.abs(x ?? 0)), 0);
    const { recorded, healthy } = this.traces;
    const before = largest(recorded.map((x, n) => x - (healthy[n] ?? x)));
    const most = 1.05 * Math.max(before, largest(this.answer.residual)) || 1;
    return [-most, most];
  }

  // Where the slider of a profile stands, and where it would be healthy.
  mark(plot, color) {
    const { profile } = this;
    if (!profile) return;
    const { ctx, bbox } = plot;
    const one = this.rows.get(profile.along).one;
    const line = (value, tone, width) => {
      if (value === null) return;
      const x = plot.valToPos(between(profile.position, profile.x, value), "x", true);
      ctx.save();
      ctx.strokeStyle = tone;
      ctx.lineWidth = width * devicePixelRatio;
      ctx.beginPath();
      ctx.moveTo(x, bbox.top);
      ctx.lineTo(x, bbox.top + bbox.height);
      ctx.stroke();
      ctx.restore();
    };
    line(one.healthy, color("healthy"), 1);
    line(one.truth, color("truth"), 1);
    line(this.values[profile.along], color("twin"), 2);
  }

  paint() {
    const { answer, traces, profile, setup } = this;
    for (const plot of this.plots) {
      if (plot.figure === "answer") {
        const seen = setup.recorded ? [traces.recorded] : [];
        plot.setData([setup.time, traces.healthy, ...seen, answer.twin]);
      } else if (plot.figure === "residual") {
        plot.setData([setup.time, answer.residual]);
      } else if (plot.figure === "profile" && profile) {
        const { one } = this.rows.get(profile.along);
        plot.heading.firstChild.textContent = `Misfit along ${one.title.toLowerCase()}`;
        plot.axes[0].label = profile.unit || one.title.toLowerCase();
        plot.setData([profile.x, profile.misfit.map((x) => (x === null ? null : 100 * x))]);
      }
    }
  }

  resize() {
    for (const plot of this.plots) {
      const width = plot.root.parentNode.clientWidth;
      if (width > 0 && width !== plot.width) plot.setSize({ width, height: plot.height });
    }
  }
}

// Where a value lies in the range of its slider, 0 to 1, and back.
function share({ lower, upper, logarithmic }, value) {
  return logarithmic ? Math.log(value / lower) / Math.log(upper / lower) : (value - lower) / (upper - lower);
}

function value({ lower, upper, logarithmic }, share) {
  const found = logarithmic ? lower * (upper / lower) ** share : lower + share * (upper - lower);
  return Math.min(Math.max(found, lower), upper);
}

// y at a point of rising xs, on straight lines between them.
function between(xs, ys, x) {
  const n = Math.min(Math.max(xs.findIndex((one) => one >= x), 1), xs.length - 1);
  return ys[n - 1] + ((x - xs[n - 1]) / (xs[n] - xs[n - 1])) * (ys[n] - ys[n - 1]);
}

function percent(x) {
  if (x === null) return "diverged";
  return x < 1e-4 ? "< 0.01 %" : `${(100 * x).toPrecision(3)} %`;
}

function at(element, share) {
  element.style.setProperty("--ee-at", share);
  return element;
}

// An element; text goes in as text, never as markup.
function make(tag, attributes, ...children) {
  const element = document.createElement(tag);
  for (const [name, text] of Object.entries(attributes)) {
    if (name === "style") element.style.cssText = text;
    else if (text !== undefined) element.setAttribute(name, text);
  }
  element.append(...children);
  return element;
}

export default {
  render({ model, el }) {
    const explorer = new Explorer(model, el);
    explorer.open();
    return () => explorer.close();
  },
};
