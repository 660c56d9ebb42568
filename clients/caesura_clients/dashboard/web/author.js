// The name under which this browser teaches and corrects: every page and part of a page has the same one.
export const AUTHOR = "caesura-author"; // in the browser's store, and of the event that states another name

// A refusal of the name itself: it is not kept, and asked for again.
export const isOfAuthor = (message) => message.startsWith("Not done: your name ");

export function storedAuthor() {
  return (localStorage.getItem(AUTHOR) || "").trim();
}

export function storeAuthor(name) { // other parts of the page are notified
  localStorage.setItem(AUTHOR, name);
  window.dispatchEvent(new CustomEvent(AUTHOR, { detail: name }));
}
