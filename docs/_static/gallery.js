// Thumbnails above the gallery: pictures of its own figures, each a link to the one it shows.
addEventListener("load", async () => {
  const list = document.createElement("nav");
  list.className = "thumbnails";
  list.setAttribute("aria-label", "Figures");
  const seen = new Set();
  for (const figure of document.querySelectorAll(".js-plotly-plot")) {
    const section = figure.closest("section");
    if (seen.has(section)) continue;
    seen.add(section);
    const title = section.querySelector("h2, h3").firstChild.textContent;
    const link = document.createElement("a");
    const picture = document.createElement("img");
    link.href = `#${section.id}`;
    picture.alt = "";
    picture.src = await Plotly.toImage(figure, { format: "png", width: 720, height: 480 });
    link.append(picture, title);
    list.append(link);
  }
  document.querySelector("section section").before(list);
});
