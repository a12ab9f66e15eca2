// Requests to this page's server. A refusal's sentence becomes the text of the error.

export async function asked(address, options = {}) {
  let answer;
  try {
    answer = await fetch(address, options);
  } catch {
    throw new Error("The server does not answer; expected it to run. Start hand-recon demo again, and reload the page.");
  }
  const content = await answer.json().catch(() => null);
  if (!answer.ok) {
    throw new Error(content?.error ?? `The server answered ${answer.status}; expected a result. Reload the page.`);
  }
  return content;
}

export function sent(name, content) {
  return asked(`api/file?name=${encodeURIComponent(name)}`, { method: "POST", body: content });
}

export function unpacked(text, Kind) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new Kind(bytes.buffer);
}
