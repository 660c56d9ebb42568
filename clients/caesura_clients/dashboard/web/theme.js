// Light or dark: what was chosen here before, else what the machine prefers. Runs before anything is drawn.
const KEY = "caesura-theme";
const machine = matchMedia("(prefers-color-scheme: dark)");
const set = () => {
  document.documentElement.dataset.theme = localStorage.getItem(KEY) || (machine.matches ? "dark" : "light");
};
machine.addEventListener("change", set);
set();
window.caesuraTheme = () => {
  localStorage.setItem(KEY, document.documentElement.dataset.theme === "dark" ? "light" : "dark");
  set();
};
