// A request is kept until its answer comes. A page that is loaded again, as after a lost connection, states one without.
export const unanswered = (name) => {
  const key = `caesura-unanswered-${name}`;
  const forget = () => sessionStorage.removeItem(key);
  return {
    forget,
    keep: (asked) => sessionStorage.setItem(key, JSON.stringify(asked)),
    recall(isHere) { // the request, once; null without one, or where it was for another station or session
      const asked = JSON.parse(sessionStorage.getItem(key));
      if (!asked || !isHere(asked)) return null;
      forget();
      return asked;
    },
  };
};
