// A page whose login has ended cannot connect again: then it says so in the place of "Trying to reconnect", and what to do.
const AGAIN_MS = 2000;
const ENDED = "The login of this browser has ended. Log in in another tab, then this page connects again: ";

const hasEnded = async () => { // what is not logged in is led to the login
  const answer = await fetch("/assets/login.js", { redirect: "manual", cache: "no-store" }).catch(() => null);
  return answer !== null && answer.type === "opaqueredirect";
};
const say = (line) => {
  const link = Object.assign(document.createElement("a"), { href: "/login", target: "_blank", textContent: "log in" });
  line.replaceChildren(ENDED, link);
};

addEventListener("load", () => {
  const popup = document.getElementById("popup"), line = popup.lastElementChild, words = line.textContent;
  setInterval(async () => {
    if (window.socket?.connected) line.textContent = words;
    else if (line.childElementCount === 0 && await hasEnded()) {
      say(line);
      popup.ariaHidden = false; // also where the page has never been connected
    }
  }, AGAIN_MS);
});
