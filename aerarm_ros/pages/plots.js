// The page contains the plotly library compressed (2 of 5 MB). `newPlot` queues all figures until the
// library is unpacked and runs, including figures that plotly's own HTML export draws.
const waiting = [];
window.Plotly = {newPlot: (...call) => new Promise(done => waiting.push([call, done]))};
const dark = matchMedia('(prefers-color-scheme: dark)');
const narrow = matchMedia('(max-width: 40em)');
const theme = () => {
  const style = getComputedStyle(document.documentElement);
  const [ink, line, paper] = ['--ink', '--line', '--paper'].map(
    name => style.getPropertyValue(name).trim());
  const none = 'rgba(0,0,0,0)';
  const axis = {color: ink, gridcolor: line, zerolinecolor: line, linecolor: line};
  const side = {...axis, backgroundcolor: none};
  return {layout: {
    paper_bgcolor: none, plot_bgcolor: none, xaxis: axis, yaxis: axis,
    font: {color: ink, family: 'system-ui, sans-serif'}, legend: {bgcolor: none},
    hoverlabel: {bgcolor: paper, font: {color: ink}},
    modebar: {bgcolor: none, color: line, activecolor: ink},
    colorway: ['#d9722e', '#3b82c4', '#3aa655', '#a45cc4', '#d04a4a', '#1a9aa8', '#c99a1f'],
    scene: {xaxis: side, yaxis: side, zaxis: side},
  }};
};
// Colours of the dark theme, as replacements for colours that would be too dark on black.
const lighter = {
  '#0b4fa3': '#6fa8f0', '#0b62c4': '#6fa8f0', '#b3261e': '#f2746b', '#1c2430': '#e3e7ed',
  '#0b7a3b': '#5fcf8e', '#444b54': '#76808d', '#a9bdd6': '#5a7394', '#9467bd': '#b08ad6',
  '#8c564b': '#b98276', '#1f77b4': '#4a9ad4',
};
const shown = color => Array.isArray(color) ? color.map(shown) : lighter[color] ?? color;
const colored = traces => !dark.matches ? traces : traces.map(trace => {
  const own = {...trace};
  if (own.color) own.color = shown(own.color);
  for (const part of ['line', 'marker'])
    if (own[part]?.color) own[part] = {...own[part], color: shown(own[part].color)};
  return own;
});
// On a narrow screen, legends are above their plot, row names above their rows, and buttons above
// their sliders. A finger that moves over a plot scrolls the page.
const fitted = (traces, asked) => {
  const layout = {...asked, template: theme(), uirevision: 'kept'};
  if (!narrow.matches) return layout;
  const margin = layout.margin = {...asked.margin};
  const grow = (side, more) => {
    margin[side] = (margin[side] ?? 80) + more;
    layout.height = (layout.height ?? 450) + more;
  };
  margin.r = Math.min(margin.r ?? 80, 15);
  const ink = getComputedStyle(document.documentElement).getPropertyValue('--ink').trim();
  const rows = new Set(asked.yaxis?.type == 'category' ? traces.flatMap(one => one.y) : []);
  const columns = new Set(asked.xaxis?.tickangle == 90 ? traces.flatMap(one => one.x) : []);
  if (rows.size) {
    margin.l = 10;
    layout.height += 14 * rows.size;
    layout.bargap = 0.75;
    layout.yaxis = {
      ...asked.yaxis, ticklabelposition: 'inside top', ticklabelshift: -6,
      tickfont: {size: 10, color: ink}};
  }
  if (columns.size) layout.width = 110 + 12 * columns.size;
  if (asked.legend?.orientation != 'h')
    layout.legend = {...asked.legend, orientation: 'h', x: 0, y: 1.02, yanchor: 'bottom'};
  if (asked.annotations?.length > 2) {
    layout.annotations = asked.annotations.map(one => ({...one, textangle: -90}));
    grow('t', 80);
  }
  if (asked.sliders) {
    layout.updatemenus = asked.updatemenus.map(one => ({...one, x: 0, xanchor: 'left'}));
    layout.sliders = asked.sliders.map(one => ({...one, x: 0, len: 1, pad: {t: 60}}));
    grow('b', 60);
  }
  if (asked.scene) {
    const eye = asked.scene.camera?.eye ?? {x: 1.25, y: 1.25, z: 1.25};
    const far = Object.fromEntries(Object.entries(eye).map(([side, place]) => [side, 1.3 * place]));
    layout.scene = {...asked.scene, camera: {...asked.scene.camera, eye: far}};
  } else layout.dragmode = false;
  return layout;
};
const drawn = [];
const show = (draw, [place, traces, layout, options]) => draw(
  place, structuredClone(colored(traces)), structuredClone(fitted(traces, layout)),
  {...options, displayModeBar: narrow.matches ? false : 'hover'});
const plotting = (async () => {
  const bytes = Uint8Array.from(atob('PACKED'), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('gzip'));
  const script = document.createElement('script');
  script.textContent = await new Response(stream).text();
  document.head.append(script);
  const plot = Plotly.newPlot;
  const draw = (...call) => {
    drawn.push(call);
    return show(plot, call);
  };
  Plotly.newPlot = draw;
  for (const [call, done] of waiting) done(draw(...call));
  for (const setting of [dark, narrow])
    setting.addEventListener('change', () => drawn.forEach(call => show(Plotly.react, call)));
})();
plotting.catch(() => document.body.prepend(
  'Update your browser to see the figures: they need Chrome 80, Firefox 113 or Safari 16.4.'));
