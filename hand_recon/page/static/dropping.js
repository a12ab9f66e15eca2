// Files that are dropped anywhere on the page, or pasted.

export function listenForFiles(place, openFile, tell) {
  let inside = 0;
  const mark = (by) => {
    inside = Math.max(0, inside + by);
    place.classList.toggle("is-over", inside > 0);
  };
  window.addEventListener("dragenter", () => mark(1));
  window.addEventListener("dragleave", () => mark(-1));
  window.addEventListener("dragover", (event) => event.preventDefault());
  window.addEventListener("drop", (event) => {
    event.preventDefault();
    mark(-inside);
    const { files } = event.dataTransfer;
    if (files[0]) openFile(files[0]);
    if (files.length > 1) tell(`${files.length} files were dropped; expected one at a time. The first is opened, ${files[0].name}.`);
  });
  window.addEventListener("paste", (event) => {
    if (event.clipboardData.files[0]) openFile(event.clipboardData.files[0]);
  });
}
