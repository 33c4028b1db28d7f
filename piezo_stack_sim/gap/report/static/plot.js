// One plot: an SVG that draws its series anew for every range it is shown.

const SVG = 'http://www.w3.org/2000/svg';
const MARGIN = {left: 62, right: 10, top: 8, bottom: 34};

function element(name, attributes, parent, text) {
  const made = name === 'svg' || parent instanceof SVGElement
    ? document.createElementNS(SVG, name) : document.createElement(name);
  for (const key in attributes) made.setAttribute(key, attributes[key]);
  if (text !== undefined) made.textContent = text;   // as text, never as markup
  if (parent) parent.appendChild(made);
  return made;
}

class Plot {
  // options: title, x: {label, unit}, y: {label, unit}, logarithmic, free (zooms in both directions),
  // height, series(): [{line, x, y}], range(): [x0, x1] or null, onRange([x0, x1] or null),
  // band: half width about zero or null, mark(): [x0, x1] or null
  constructor(parent, options) {
    this.options = options;
    this.box = null;                                  // own y range of a free plot
    const root = element('div', {class: 'plot'}, parent);
    const head = element('h4', {}, root);
    element('span', {}, head, options.title);
    this.output = element('output', {}, head);
    this.svg = element('svg', {tabindex: 0, role: 'img', 'aria-label': options.title}, root);
    this.root = root;
    this.listen();
  }

  draw() {
    const {options, svg} = this;
    const width = Math.max(this.root.clientWidth, 200), height = options.height(width);
    this.area = {left: MARGIN.left, top: MARGIN.top, width: width - MARGIN.left - MARGIN.right,
                 height: height - MARGIN.top - MARGIN.bottom};
    svg.setAttribute('viewBox', `0 0 ${width} ${height}`);
    svg.replaceChildren();
    this.series = options.series();
    if (!this.series.some(one => one.x.length)) {
      element('text', {x: width / 2, y: height / 2, 'text-anchor': 'middle'}, svg, 'nothing measured');
      this.area = null;
      return;
    }
    this.ranges();
    this.axes();
    this.lines();
    this.over = element('g', {}, svg);
  }

  ranges() {
    const {options, series} = this;
    const shared = options.range();
    const used = series.filter(one => one.line !== 'noise');
    if (options.logarithmic) {
      const [x0, x1] = shared || extent(used, 'x');
      const [y0, y1] = extent(series, 'y', [x0, x1]) || [1, 10];
      this.x = [x0, x1];
      this.y = [y0 / 1.6, y1 * 1.6];
    } else if (options.free) {
      this.x = this.box ? this.box.x : padded(extent(used, 'x'), 0.04);
      this.y = this.box ? this.box.y : padded(extent(used, 'y'), 0.06);
    } else {
      this.x = shared || extent(used, 'x');
      const around = extent(series, 'y', this.x) || [0, 1];
      const band = options.band || 0;
      this.y = padded([Math.min(around[0], band ? -band : Infinity),
                       Math.max(around[1], band || -Infinity)], 0.07);
    }
    const size = range => Math.max(Math.abs(range[0]), Math.abs(range[1]));
    this.xScale = options.logarithmic ? {factor: 1, unit: options.x.unit}
      : siScale(options.free ? size(this.x) : this.x[1] - this.x[0], options.x.unit);
    if (!options.free && !options.logarithmic && size(this.x) > 2000 * this.xScale.factor) {
      this.xScale = siScale(size(this.x), options.x.unit);   // a short stretch late in the recording
    }
    this.yScale = options.logarithmic ? siScale(this.y[1] / 3, options.y.unit)
      : siScale(size(this.y), options.y.unit);
    const {left, top, width, height} = this.area;
    const log = options.logarithmic ? Math.log : value => value;
    const place = (range, start, length) => {
      const low = log(range[0]), per = length / (log(range[1]) - low);
      return value => start + (log(value) - low) * per;
    };
    this.px = place(this.x, left, width);
    this.py = place(this.y, top + height, -height);
  }

  axes() {
    const {svg, options, area} = this;
    const bottom = area.top + area.height, right = area.left + area.width;
    const ticks = (range, scale, length, each) => {
      const scaled = range.map(value => value / scale.factor);
      const made = options.logarithmic ? decadeTicks(scaled, length / each)
        : linearTicks(scaled, length / each);
      return made.ticks.map(tick => [tick * scale.factor, numberText(tick, made.digits)]);
    };
    for (const [value, text] of ticks(this.x, this.xScale, area.width, 58)) {
      const x = this.px(value).toFixed(1);
      element('line', {class: 'grid', x1: x, x2: x, y1: area.top, y2: bottom}, svg);
      element('text', {x: x, y: bottom + 14, 'text-anchor': 'middle'}, svg, text);
    }
    for (const [value, text] of ticks(this.y, this.yScale, area.height, 38)) {
      const y = this.py(value).toFixed(1);
      element('line', {class: 'grid', x1: area.left, x2: right, y1: y, y2: y}, svg);
      element('text', {x: area.left - 6, y: +y + 4, 'text-anchor': 'end'}, svg, text);
    }
    element('path', {class: 'frame', d: `M${area.left} ${area.top}V${bottom}H${right}`}, svg);
    const name = (axis, scale) => scale.unit ? `${axis.label} (${scale.unit})` : axis.label;
    element('text', {x: area.left + area.width / 2, y: bottom + 29, 'text-anchor': 'middle'}, svg,
            name(options.x, this.xScale));
    element('text', {transform: `translate(11 ${area.top + area.height / 2}) rotate(-90)`,
                     'text-anchor': 'middle'}, svg, name(options.y, this.yScale));
  }

  lines() {
    const {svg, area, options} = this;
    const id = `clip-${Plot.count = (Plot.count || 0) + 1}`;
    const clip = element('clipPath', {id: id}, svg);
    element('rect', {x: area.left, y: area.top, width: area.width, height: area.height}, clip);
    const inside = element('g', {'clip-path': `url(#${id})`}, svg);
    if (options.band) {
      const high = this.py(options.band), low = this.py(-options.band);
      element('rect', {class: 'band', x: area.left, width: area.width, y: high, height: low - high}, inside);
    }
    const mark = options.mark && options.mark();
    if (mark && (mark[0] > this.x[0] || mark[1] < this.x[1])) {
      const start = this.px(mark[0]), wide = Math.max(this.px(mark[1]) - start, 3);
      element('rect', {class: 'stretch', x: start, width: wide, y: area.top, height: area.height}, inside);
    }
    for (const one of this.series) {
      element('path', {class: `line ${one.line}`, d: this.path(one)}, inside);
    }
  }

  path(one) {
    const {x, y} = one, steps = [];
    let pen = 'M';
    for (let i = 0; i < x.length; i++) {
      if (x[i] === null || y[i] === null || (this.options.logarithmic && !(y[i] > 0))) { pen = 'M'; continue; }
      // A neighbour on either side of the range is drawn too, so that lines run on to the edge
      if (!this.options.free && (x[i + 1] < this.x[0] || x[i - 1] > this.x[1])) { pen = 'M'; continue; }
      steps.push(pen + this.px(x[i]).toFixed(1) + ' ' + this.py(y[i]).toFixed(1));
      pen = 'L';
    }
    return steps.join('');
  }

  // --- pointer and keyboard

  listen() {
    const {svg} = this;
    svg.addEventListener('pointerdown', event => {
      if (!this.area || event.button) return;
      this.start = this.at(event);
      if (event.pointerType !== 'touch') svg.setPointerCapture(event.pointerId);
    });
    svg.addEventListener('pointermove', event => {
      if (!this.area) return;
      if (this.start) this.rubber(this.at(event)); else this.hover(this.at(event));
    });
    svg.addEventListener('pointerup', event => {
      const start = this.start;
      this.start = null;
      if (!start || !this.area) return;
      this.over.replaceChildren();
      const end = this.at(event);
      if (Math.abs(end[0] - start[0]) > 6) this.zoomTo(start, end);
    });
    svg.addEventListener('pointercancel', () => { this.start = null; if (this.over) this.over.replaceChildren(); });
    svg.addEventListener('pointerleave', () => {
      if (this.start || !this.over) return;
      this.over.replaceChildren();
      this.output.textContent = '';
    });
    svg.addEventListener('dblclick', () => this.reset());
    svg.addEventListener('wheel', event => {
      if (!this.area || !(event.ctrlKey || event.metaKey)) return;   // the page still scrolls
      event.preventDefault();
      this.zoomBy(event.deltaY > 0 ? 1.25 : 0.8, this.at(event));
    }, {passive: false});
    svg.addEventListener('keydown', event => {
      const act = {'+': () => this.zoomBy(0.7), '=': () => this.zoomBy(0.7), '-': () => this.zoomBy(1.4),
                   '0': () => this.reset(), 'Escape': () => this.reset(),
                   'ArrowLeft': () => this.pan(-0.2), 'ArrowRight': () => this.pan(0.2)}[event.key];
      if (!act || !this.area || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      act();
    });
  }

  at(event) {
    const rect = this.svg.getBoundingClientRect();
    const scale = this.svg.viewBox.baseVal.width / rect.width;
    const {left, top, width, height} = this.area;
    return [Math.min(Math.max((event.clientX - rect.left) * scale, left), left + width),
            Math.min(Math.max((event.clientY - rect.top) * scale, top), top + height)];
  }

  value(range, share) {
    if (!this.options.logarithmic) return range[0] + share * (range[1] - range[0]);
    return range[0] * (range[1] / range[0]) ** share;
  }

  values([x, y]) {
    const {left, top, width, height} = this.area;
    return [this.value(this.x, (x - left) / width), this.value(this.y, 1 - (y - top) / height)];
  }

  rubber(end) {
    const {start, area, options} = this;
    const [x0, x1] = [Math.min(start[0], end[0]), Math.max(start[0], end[0])];
    const [y0, y1] = options.free ? [Math.min(start[1], end[1]), Math.max(start[1], end[1])]
      : [area.top, area.top + area.height];
    this.over.replaceChildren();
    element('rect', {class: 'zoom', x: x0, y: y0, width: x1 - x0, height: y1 - y0}, this.over);
  }

  zoomTo(start, end) {
    const [a, b] = [this.values(start), this.values(end)];
    const x = [Math.min(a[0], b[0]), Math.max(a[0], b[0])];
    const y = [Math.min(a[1], b[1]), Math.max(a[1], b[1])];
    this.show(x, y[1] > y[0] ? y : this.y);
  }

  zoomBy(ratio, about) {
    const {left, top, width, height} = this.area;
    const [cx, cy] = about || [left + width / 2, top + height / 2];
    const span = (range, share) => [this.value(range, share - share * ratio), this.value(range, share + (1 - share) * ratio)];
    this.show(span(this.x, (cx - left) / width), span(this.y, 1 - (cy - top) / height));
  }

  pan(share) {
    this.show([this.value(this.x, share), this.value(this.x, 1 + share)], this.y);
  }

  show(x, y) {
    if (this.options.free) {
      this.box = {x: x, y: y};
      this.draw();
    } else {
      this.options.onRange(x);
    }
  }

  reset() {
    this.box = null;
    if (this.options.free) this.draw(); else this.options.onRange(null);
  }

  hover(point) {
    const {options, area, series} = this;
    const [x, y] = this.values(point);
    const bare = (value, scale) => {
      const scaled = value / scale.factor;
      const digits = 3 - Math.floor(Math.log10(Math.abs(scaled) || 1));
      return numberText(scaled, Math.max(0, Math.min(3, digits)));
    };
    const text = (value, scale) => `${bare(value, scale)} ${scale.unit}`;
    this.over.replaceChildren();
    if (options.free) {
      this.output.textContent = `${text(x, this.xScale)}, ${text(y, this.yScale)}`;
      return;
    }
    const at = this.px(x).toFixed(1);
    element('line', {class: 'cursor', x1: at, x2: at, y1: area.top, y2: area.top + area.height}, this.over);
    const parts = series.filter(one => one.line !== 'noise').map(one => {
      const value = one.y[nearest(one.x, x)];
      return value === null ? '–' : bare(value, this.yScale);
    });
    this.output.textContent = `${text(x, this.xScale)}: ${parts.join(' · ')} ${this.yScale.unit}`;
  }
}

function nearest(sorted, value) {
  let low = 0, high = sorted.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (sorted[middle] < value) low = middle; else high = middle;
  }
  return value - sorted[low] < sorted[high] - value ? low : high;
}
