import { defineConfig } from "vite";

/** Names the studio in the page itself, so that it is fetched before the script that starts it has run. */
const fetchedEarly = {
  name: "fetched-early",
  transformIndexHtml: {
    order: "post",
    handler: (_, { bundle = {} }) =>
      Object.values(bundle)
        .filter((one) => one.isDynamicEntry)
        .map((one) => ({ tag: "link", attrs: { rel: "modulepreload", crossorigin: true, href: `/${one.fileName}` }, injectTo: "head" })),
  },
};

export default defineConfig({
  plugins: [fetchedEarly],
  base: "/",
  build: {
    outDir: "../server/static",
    emptyOutDir: true,
    assetsInlineLimit: 0, // the policy of the page allows no data: scripts or fonts
    modulePreload: { polyfill: false }, // it would be an inline script
    license: { fileName: "third-party.md" },
    target: "es2022",
    chunkSizeWarningLimit: 900,
  },
  server: { proxy: { "/v1": "http://127.0.0.1:8000", "/readyz": "http://127.0.0.1:8000" } },
});
