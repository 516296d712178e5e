"use strict";
const index = JSON.parse(document.getElementById("index").textContent);
const asked = new URLSearchParams(location.search).get("q") || "";
const words = asked.toLowerCase().split(/\s+/).filter(Boolean);
const matches = words.length
  ? index.filter(([text]) => words.every((word) => text.toLowerCase().includes(word)))
  : [];
document.querySelector("input[name=q]").value = asked;
document.getElementById("count").textContent = words.length ? `${matches.length} found` : "";
for (const [text, title, address] of matches) {
  const link = document.createElement("a");
  link.href = address;
  link.textContent = text === title ? text : `${text} (${title})`;
  document.getElementById("found").appendChild(document.createElement("li")).append(link);
}
