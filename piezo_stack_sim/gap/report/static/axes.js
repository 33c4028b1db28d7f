'use strict';
// Axes: round ticks, SI prefixes, the range that data take up.

const PREFIXES = {'-15': 'f', '-12': 'p', '-9': 'n', '-6': 'µ', '-3': 'm', 0: '', 3: 'k', 6: 'M', 9: 'G'};

// The power of ten and the prefixed unit in which `size` reads as 1 to 999.
function siScale(size, unit) {
  if (!(size > 0) || !unit) return {factor: 1, unit: unit};
  let exponent = 3 * Math.floor(Math.log10(size * 1.0005) / 3);
  exponent = Math.min(Math.max(exponent, -15), unit === 's' ? 0 : 9);
  return {factor: 10 ** exponent, unit: PREFIXES[exponent] + unit};
}

// Smallest and largest finite value of several series over the points from x0 to x1.
function extent(series, key, within) {
  let low = Infinity, high = -Infinity;
  for (const one of series) {
    const values = one[key];
    for (let i = 0; i < values.length; i++) {
      const value = values[i];
      if (value === null || (within && (one.x[i] < within[0] || one.x[i] > within[1]))) continue;
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  return low <= high ? [low, high] : null;
}

// Room above and below; something to stand on where all values are alike.
function padded(range, share) {
  const [low, high] = range;
  const room = (high - low) * share || Math.abs(high) * 0.05 || 1;
  return [low - room, high + room];
}

function linearTicks([low, high], count) {
  const raw = (high - low) / Math.max(count, 1);
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map(m => m * power).find(m => m >= raw * 0.999);
  const ticks = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; i++) ticks.push(i * step);
  return {ticks: ticks, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9))};
}

function decadeTicks([low, high], count) {
  const first = Math.ceil(Math.log10(low) - 1e-9), last = Math.floor(Math.log10(high) + 1e-9);
  const every = Math.max(1, Math.ceil((last - first + 1) / count));
  const ticks = [];
  for (let i = first; i <= last; i += every) ticks.push(10 ** i);
  if (ticks.length > 1) return {ticks: ticks, digits: null};
  const steps = [];                                   // less than a decade or so: 1, 2, 5 of each
  for (let i = first - 1; i <= last + 1; i++) {
    for (const m of [1, 2, 5]) if (m * 10 ** i >= low && m * 10 ** i <= high) steps.push(m * 10 ** i);
  }
  return {ticks: steps, digits: null};
}

// A number with a true minus sign; powers of ten as words where they would be long.
function numberText(value, digits) {
  if (digits === null) {
    const exponent = 3 * Math.floor(Math.log10(value * 1.0005) / 3);
    if (exponent >= 3) return +(value / 10 ** exponent).toPrecision(3) + (PREFIXES[exponent] || 'e' + exponent);
    return value >= 1e-3 ? String(+value.toPrecision(3)) : value.toExponential(0).replace('-', '−');
  }
  return value.toFixed(digits).replace('-', '−').replace(/^−(0(\.0*)?)$/, '$1');
}
