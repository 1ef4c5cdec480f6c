setInterval(() => {
  const mode = document.querySelector('.arm-mode');
  if (mode && document.title !== mode.dataset.title) document.title = mode.dataset.title;
  // A plot that received data before its width was known shows no numbers at its time axis.
  for (const {chart} of Object.values(window.__viserTestpoints?.uplots ?? {}))
    if (!chart.axes[0]._splits?.length) chart.redraw(false, true);
}, 300);
