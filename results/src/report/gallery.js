// Shows the clouds of a report in its canvases. Stands behind viewer.js in one script.

const clouds = JSON.parse(document.getElementById('clouds').textContent);

/** A cloud by its number, from base 64. */
function cloudAt(place) {
  return decodeCloud(Uint8Array.from(atob(clouds[place]), (letter) => letter.charCodeAt(0)).buffer);
}

for (const figure of document.querySelectorAll('.triple')) {
  const viewers = [...figure.querySelectorAll('canvas')].map((canvas) => {
    const viewer = createViewer(canvas, { label: canvas.dataset.label });
    viewer.setCloud(cloudAt(Number(canvas.dataset.cloud)));
    return viewer;
  });
  link(viewers);
}
