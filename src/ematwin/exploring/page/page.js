// Joins the explorer to the server of this page, with the few methods of an anywidget model.
import explorer from "./explore.js";

const hear = [];
const model = {
  on(event, listener) { if (event === "msg:custom") hear.push(listener); },
  off() {},
  async send(question) {
    let answer;
    try {
      const reply = await fetch("ask", {
        method: "POST",
        headers: { "Content-Type": "application/json" },
        body: JSON.stringify(question),
      });
      answer = reply.ok ? await reply.json() : { error: `The server refused: ${reply.statusText}.` };
    } catch {
      answer = { error: "The server has ended. Run ematwin explore again." };
    }
    hear.forEach((listener) => listener({ id: question.id, answer }));
  },
};
explorer.render({ model, el: document.getElementById("explorer") });
