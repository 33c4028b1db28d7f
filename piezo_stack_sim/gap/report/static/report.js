// The plots of the page: which recording, which stretch, which lines.

(function () {
  const source = document.getElementById('data');
  if (!source) return;
  const data = JSON.parse(source.textContent);
  const byId = id => document.getElementById(id);
  const buttons = name => Array.from(document.querySelectorAll(`[data-${name}]`));
  const LOOPS = [['voltage', 'charge'], ['charge', 'displacement'], ['voltage', 'displacement']];
  const WIRE = {measured: 'measured', before: 'simulated_before', after: 'simulated_after'};
  const shown = {measured: true, before: true, after: true};
  const state = {recording: null, range: null, frequencies: null};
  let plots = [];

  // Above this distance from what was left out, lines between the rows that are left mean nothing.
  const COARSE = 0.1;

  // Every row where the stretch is known in full, the thinned-out recording elsewhere.
  function view() {
    const {overview, detail} = state.recording.views;
    if (!detail || !state.range) return overview;
    const [first, last] = [detail.time[0], detail.time[detail.time.length - 1]];
    return state.range[0] >= first - 1e-9 && state.range[1] <= last + 1e-9 ? detail : overview;
  }

  // A loop of a recording that is too dense to be thinned out is drawn from the stretch instead.
  function loopView() {
    const {overview, detail} = state.recording.views;
    return !state.range && detail && overview.error > COARSE ? detail : view();
  }

  function detailRange() {
    const {detail} = state.recording.views;
    return detail ? [detail.time[0], detail.time[detail.time.length - 1]] : null;
  }

  function lines(make) {
    return Object.keys(WIRE).filter(line => shown[line]).map(line => {
      const made = make(line);
      return made && {line: line, x: made[0], y: made[1]};
    }).filter(one => one);
  }

  const signal = (shot, channel, line) => {
    const signals = shot.channels[channel];
    if (signals) return signals[WIRE[line]] || null;
    const commanded = channel === state.recording.drive && shot.command;
    return commanded || null;
  };

  const minus = (a, b) => a.map((value, i) => value === null || b[i] === null ? null : value - b[i]);

  function setRange(range) {
    const {time} = state.recording.views.overview;
    const whole = [time[0], time[time.length - 1]];
    if (range) {
      const wide = Math.min(range[1] - range[0], whole[1] - whole[0]);
      const first = Math.min(Math.max(range[0], whole[0]), whole[1] - wide);
      range = wide > 0.999 * (whole[1] - whole[0]) ? null : [first, first + wide];
    }
    state.range = range;
    for (const plot of plots) plot.box = null;
    draw();
  }

  function tracePlots() {
    const parent = byId('plots-traces');
    parent.replaceChildren();
    const common = {
      x: {label: 'Time', unit: 's'}, range: () => state.range, onRange: setRange, mark: detailRange,
    };
    for (const channel of data.channels.filter(name => state.recording.views.overview.channels[name])) {
      const pair = element('div', {class: 'pair'}, parent);
      const unit = data.units[channel];
      plots.push(new Plot(pair, {
        ...common, title: capital(channel), y: {label: capital(channel), unit: unit},
        height: width => width < 420 ? 190 : 215,
        series: () => lines(line => [view().time, signal(view(), channel, line)]).filter(one => one.y),
      }));
      plots.push(new Plot(pair, {
        ...common, title: 'Measured minus simulated', y: {label: 'Residual', unit: unit},
        height: width => width < 420 ? 150 : 160, band: 2 * (data.noise[channel] || 0),
        series: () => lines(line => {
          const simulated = line !== 'measured' && signal(view(), channel, line);
          return simulated && [view().time, minus(signal(view(), channel, 'measured'), simulated)];
        }),
      }));
    }
    const inputs = drivenBy(state.recording);
    const pair = inputs.length && element('div', {class: 'pair'}, parent);
    for (const [key, title, unit] of inputs) {
      plots.push(new Plot(pair, {
        ...common, title: title, y: {label: title, unit: unit},
        height: width => width < 420 ? 190 : 215,
        series: () => [{line: 'input', x: view().time, y: view()[key]}],
      }));
    }
  }

  // What drove the device and is not among the measured channels.
  function drivenBy({drive, views: {overview}}) {
    const inputs = [];
    if (overview.command && !overview.channels[drive]) {
      inputs.push(['command', `${capital(drive)} command`, {voltage: 'V', charge: 'C'}[drive]]);
    }
    if (overview.external_force && overview.external_force.some(force => force)) {
      inputs.push(['external_force', 'External force', 'N']);
    }
    return inputs;
  }

  function loopPlots() {
    const parent = byId('plots-loops');
    if (!parent) return;
    parent.replaceChildren();
    const {channels, command} = state.recording.views.overview;
    const known = name => channels[name] || (name === state.recording.drive && command);
    for (const [x, y] of LOOPS) {
      if (!known(x) || !channels[y]) continue;
      const horizontal = channels[x] ? capital(x) : `${capital(x)} command`;
      plots.push(new Plot(parent, {
        title: `${capital(x)} to ${y}`, free: true,
        x: {label: horizontal, unit: data.units[x] || {voltage: 'V', charge: 'C'}[x]},
        y: {label: capital(y), unit: data.units[y]},
        height: width => Math.min(width, 340), range: () => null,
        series: () => lines(line => {
          const shot = loopView(), wide = signal(shot, x, line), high = signal(shot, y, line);
          if (!wide || !high) return null;
          const [low, top] = state.range || [-Infinity, Infinity];
          const inside = shot.time.map(t => t >= low && t <= top);
          return [wide.filter((_, i) => inside[i]), high.filter((_, i) => inside[i])];
        }),
      }));
    }
    if (!parent.children.length) element('p', {}, parent, 'Two channels are needed to draw a loop.');
  }

  function spectrumPlots() {
    const parent = byId('plots-spectra');
    if (!parent) return;
    parent.replaceChildren();
    for (const channel of data.channels.filter(name => state.recording.spectra[name])) {
      const spectrum = state.recording.spectra[channel];
      plots.push(new Plot(parent, {
        title: capital(channel), logarithmic: true,
        x: {label: 'Frequency', unit: 'Hz'}, y: {label: 'Residual', unit: `${data.units[channel]}/√Hz`},
        height: () => 250, range: () => state.frequencies,
        onRange: range => {
          // Zooming out stops at what was measured
          const first = spectrum.frequency[0], last = spectrum.frequency[spectrum.frequency.length - 1];
          state.frequencies = range && [Math.max(range[0], first), Math.min(range[1], last)];
          draw();
        },
        series: () => ['noise', 'before', 'after']
          .filter(line => spectrum[line] && (line === 'noise' || shown[line]))
          .map(line => ({line: line, x: spectrum.frequency, y: spectrum[line]})),
      }));
    }
  }

  function capital(text) {
    const words = text.replace(/_/g, ' ');
    return words.charAt(0).toUpperCase() + words.slice(1);
  }

  function choose(index) {
    state.recording = data.recordings[index];
    state.range = state.frequencies = null;
    plots = [];
    tracePlots();
    loopPlots();
    spectrumPlots();
    draw();
  }

  function draw() {
    for (const plot of plots) plot.draw();
    const stretch = byId('loops-stretch');
    if (stretch) {
      stretch.textContent = loopView() === view() ? 'Of the stretch shown above.'
        : 'Of the stretch with the largest error: the whole recording is too dense to draw.';
    }
    const detail = detailRange();
    for (const button of buttons('stretch')) {
      const whole = button.dataset.stretch === 'whole';
      button.hidden = !detail;
      button.setAttribute('aria-pressed', String(whole ? !state.range : Boolean(
        state.range && detail && state.range[0] === detail[0] && state.range[1] === detail[1])));
    }
  }

  for (const button of buttons('recording')) {
    button.addEventListener('click', () => {
      for (const other of buttons('recording')) other.setAttribute('aria-pressed', String(other === button));
      choose(Number(button.dataset.recording));
    });
  }
  for (const button of buttons('stretch')) {
    button.addEventListener('click', () => setRange(button.dataset.stretch === 'whole' ? null : detailRange()));
  }
  for (const button of buttons('line')) {
    button.addEventListener('click', () => {
      shown[button.dataset.line] = !shown[button.dataset.line];
      button.setAttribute('aria-pressed', String(shown[button.dataset.line]));
      draw();
    });
  }
  new ResizeObserver(() => requestAnimationFrame(draw)).observe(document.querySelector('main'));
  const first = buttons('recording').find(button => button.getAttribute('aria-pressed') === 'true');
  choose(first ? Number(first.dataset.recording) : 0);
})();
