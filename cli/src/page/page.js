// Shows one run of several, and opens what is folded before the page is printed.
"use strict";

const switcher = document.querySelector(".switch");
if (switcher) {
  const buttons = [...switcher.querySelectorAll("button")];
  const show = (id) => {
    for (const run of document.querySelectorAll("article.run")) run.hidden = id !== "all" && run.id !== id;
    for (const button of buttons) button.setAttribute("aria-pressed", String(button.dataset.show === id));
  };
  for (const button of buttons) button.addEventListener("click", () => show(button.dataset.show));
  // A link into a hidden run shows it.
  const follow = () => {
    const run = document.getElementById(location.hash.slice(1))?.closest("article.run");
    if (run?.hidden) {
      show(run.id);
      document.getElementById(location.hash.slice(1)).scrollIntoView();
    }
  };
  switcher.hidden = false;
  show(buttons[0].dataset.show);
  follow();
  addEventListener("hashchange", follow);
}

addEventListener("beforeprint", () => {
  for (const details of document.querySelectorAll(".sections details")) details.open = true;
});
