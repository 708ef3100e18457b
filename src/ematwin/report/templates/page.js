"use strict";
(() => {
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const narrow = 640, sheet = 690, tall = 900; // px; the last two of a sheet of A4

  // Figures: the theme of the page, and less room for margins on a phone.
  function draw(box, printed) {
    const figure = JSON.parse(box.querySelector("script").textContent);
    const layout = figure.layout, width = printed ? sheet : box.clientWidth || 800;
    const night = dark.matches && !printed;
    layout.font = { ...layout.font, color: night ? "#c9d1d9" : "#24292f" };
    layout.hoverlabel = { bgcolor: night ? "#161b22" : "#ffffff" };
    layout.modebar = { ...layout.modebar, bgcolor: "rgba(0,0,0,0)",
      color: night ? "#6e7781" : "#aeb8c2", activecolor: night ? "#e6edf3" : "#24292f" };
    for (const menu of layout.updatemenus || []) {
      menu.font = { ...menu.font, color: "#24292f" };
      menu.bgcolor = "#c6cdd5";
    }
    layout.autosize = !printed;
    if (printed) {
      layout.width = sheet;
      layout.height = Math.min(layout.height || 450, tall);
    }
    if (width < narrow) {
      layout.font.size = 11;
      layout.margin = { ...layout.margin, l: Math.min((layout.margin || {}).l ?? 40, 45), r: 8 };
      const entries = figure.data.filter((trace) => trace.showlegend !== false).length;
      if (entries > 2) {
        const extra = 18 * Math.ceil(entries / 2);
        layout.height = (layout.height || 400) + extra;
        layout.margin.b = ((layout.margin || {}).b ?? 50) + extra;
        layout.legend = { orientation: "h", x: 0, xanchor: "left", yanchor: "bottom",
          yref: "container", y: 0, font: { size: 10 } };
      }
      for (const axis of Object.values(layout)) {
        if (!axis || !Array.isArray(axis.tickvals) || axis.tickvals.length < 10) continue;
        const step = Math.ceil(axis.tickvals.length / 8), kept = (_, n) => n % step === 0;
        axis.tickvals = axis.tickvals.filter(kept);
        axis.ticktext = axis.ticktext.filter(kept);
      }
      for (const note of layout.annotations || []) note.font = { ...note.font, size: 12 };
    }
    for (const trace of figure.data) {
      for (const part of [trace.line, trace.marker]) {
        if (night && part && part.color === "#000000") part.color = "#e6edf3";
      }
    }
    let plot = box.querySelector(".plot");
    if (!plot) {
      plot = document.createElement("div");
      plot.className = "plot";
      box.append(plot);
    }
    Plotly.react(plot, figure.data, layout,
      { displaylogo: false, responsive: true, displayModeBar: width < narrow ? false : "hover" });
  }
  const boxes = [...document.querySelectorAll(".figure")];
  const all = (printed) => boxes.forEach((box) => draw(box, printed));
  let last = 0;
  if (boxes.length) {
    all(false);
    last = innerWidth;
    dark.addEventListener("change", () => all(false));
    addEventListener("beforeprint", () => all(true));
    addEventListener("afterprint", () => all(false));
    addEventListener("resize", () => {
      if (innerWidth < narrow !== last < narrow) all(false);
      last = innerWidth;
    });
  }

  // Tables that are wider than their place show their rows as cards.
  const tables = [...document.querySelectorAll("table")];
  const fit = () => tables.forEach((table) => {
    table.classList.remove("cards");
    const room = table.parentElement;
    table.classList.toggle("cards", room.scrollWidth > room.clientWidth + 1);
  });
  fit();
  addEventListener("resize", fit);
  addEventListener("beforeprint", () => tables.forEach((one) => one.classList.remove("cards")));
  addEventListener("afterprint", fit);

  // Tables: a click on a heading sorts; long ones can be filtered.
  const number = (text) => {
    const found = text.replace(/[\u2212]/g, "-").match(/^[<>x~≈]?\s*([+-]?[\d.]+(e[+-]?\d+)?)/i);
    return found ? parseFloat(found[1]) : NaN;
  };
  for (const table of tables) {
    const body = table.tBodies[0], heads = [...table.tHead.rows[0].cells];
    const rows = [...body.rows];
    if (rows.length < 2) continue;
    heads.forEach((head, place) => {
      head.tabIndex = 0;
      head.title = "Sort";
      const sort = () => {
        const down = head.getAttribute("aria-sort") === "ascending";
        heads.forEach((other) => other.removeAttribute("aria-sort"));
        head.setAttribute("aria-sort", down ? "descending" : "ascending");
        const sign = down ? -1 : 1;
        const key = (row) => row.cells[place].textContent.trim();
        [...rows].sort((one, other) => {
          const a = number(key(one)), b = number(key(other));
          if (!isNaN(a) && !isNaN(b)) return sign * (a - b);
          if (isNaN(a) !== isNaN(b)) return isNaN(a) ? 1 : -1;
          return sign * key(one).localeCompare(key(other), undefined, { numeric: true });
        }).forEach((row) => body.append(row));
      };
      head.addEventListener("click", sort);
      head.addEventListener("keydown", (event) => { if (event.key === "Enter") sort(); });
    });
    if (rows.length > 12) {
      const field = document.createElement("input");
      field.type = "search";
      field.className = "filter";
      field.placeholder = `Filter ${rows.length} rows`;
      field.setAttribute("aria-label", field.placeholder);
      field.addEventListener("input", () => {
        const wanted = field.value.toLowerCase().split(/\s+/).filter(Boolean);
        for (const row of rows) {
          const text = row.textContent.toLowerCase();
          row.hidden = !wanted.every((word) => text.includes(word));
        }
      });
      table.parentElement.before(field);
    }
  }
})();
