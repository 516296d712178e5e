"use strict";
const form = document.getElementById("filters");
const rows = [...document.querySelectorAll("tr.row")];

function filter() {
  const choices = [...form.querySelectorAll("select[name]")].map((select) => [select.name, select.value]);
  const wanted = choices.filter(([, value]) => value);
  for (const row of rows) {
    row.hidden = wanted.some(([name, value]) => row.dataset[name] !== value);
  }
  for (const section of document.querySelectorAll("main section")) {
    section.hidden = !section.querySelector("tr.row:not([hidden])");
  }
  const left = rows.filter((row) => !row.hidden).length;
  const text = left === rows.length ? "all rows shown" : `${left} of ${rows.length} rows shown`;
  document.getElementById("shown").textContent = text;
}

form.addEventListener("change", filter);
form.addEventListener("reset", () => setTimeout(filter));
form.addEventListener("submit", (event) => event.preventDefault());
filter();
