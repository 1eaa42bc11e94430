% Reads a microsig dataset, finds bright spots, writes a result:
%   start('DATASET', 'results.csv')
function start(dataset, result)
  images = dir(fullfile(dataset, 'images', '*.tif'));
  if isempty(images)
    error('%s has no TIFF images in its folder images', dataset);
  end
  names = sort({images.name});               % frames count from 0, in the order of the names
  out = fopen(result, 'w');
  if out < 0
    error('%s cannot be written', result);
  end
  fprintf(out, 'frame,track,x_px,y_px\n');
  for k = 1:numel(names)
    found = find_particles(double(imread(fullfile(dataset, 'images', names{k}))));
    for n = 1:size(found, 1)                 % indices count from 1 here, as in a result
      fprintf(out, '%d,-1,%.4f,%.4f\n', k - 1, found(n, 1), found(n, 2));
    end
  end
  fclose(out);
  fprintf('%d images, result in %s\n', numel(names), result);
end

% Positions (x, y) of particles, the first pixel being (1, 1). Put your method here.
function found = find_particles(image)
  radius = 4;                                % of the neighborhood of a particle, px
  min_snr = 5;                               % least height, in standard deviations of the smoothed noise
  [height, width] = size(image);
  smooth = zeros(height, width);
  for dy = -1:1
    for dx = -1:1
      smooth = smooth + shifted(image, dy, dx) / 9;
    end
  end
  background = median(smooth(:));
  noise = 1.4826 * median(abs(smooth(:) - background));
  [dx, dy] = meshgrid(-radius:radius);
  near = dx.^2 + dy.^2 <= radius^2;
  dx = dx(near);
  dy = dy(near);
  highest = smooth;
  for n = 1:numel(dx)
    highest = max(highest, shifted(smooth, dy(n), dx(n)));
  end
  [ys, xs] = find(smooth == highest & smooth > background + min_snr * noise);
  found = zeros(numel(xs), 2);
  for n = 1:numel(xs)
    x = xs(n) + dx;
    y = ys(n) + dy;
    inside = x >= 1 & x <= width & y >= 1 & y <= height;
    x = x(inside);
    y = y(inside);
    light = max(image(sub2ind([height width], y, x)) - background, 0);
    found(n, :) = [sum(light .* x), sum(light .* y)] / sum(light);
  end
end

% The image moved by whole pixels; its edge is repeated.
function moved = shifted(image, dy, dx)
  [height, width] = size(image);
  rows = min(max((1:height) + dy, 1), height);
  columns = min(max((1:width) + dx, 1), width);
  moved = image(rows, columns);
end
