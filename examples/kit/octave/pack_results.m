% Checks results for a suite and packs them, as python/pack.py:
%   pack_results('FOLDER', 'RESULTS', 'team.zip')
% FOLDER has suite.json of the release and the unpacked archives of its test splits; RESULTS has submission.json and
% TRACK/CASE/results.csv. Problems are an error.
function pack_results(folder, results, out)
  text = fileread(fullfile(folder, 'suite.json'));
  suite = jsondecode(text);
  edition = sprintf('%s %s, size %s', suite.name, suite.version, suite.size);
  pairs = regexp(text, '"([^"/]+/[^"]+)"\s*:\s*"([0-9a-f]{64})"', 'tokens');   % jsondecode renames such keys
  pairs = vertcat(pairs{:});
  text = fileread(fullfile(results, 'submission.json'));
  about = jsondecode(text);
  problems = {};
  for key = {'suite', 'team', 'method', 'version', 'hardware'}
    if ~isfield(about, key{1}) || ~ischar(about.(key{1})) || isempty(strtrim(about.(key{1})))
      problems{end + 1} = sprintf('submission.json: %s: expected some text', key{1});
    elseif strcmp(key{1}, 'suite') && ~strcmp(about.suite, edition)
      problems{end + 1} = sprintf('submission.json: suite: expected %s; the submission is for %s', edition, about.suite);
    end
  end
  files = {};
  is_there = false(size(pairs, 1), 1);
  for result = found_in(results)
    name = strrep(fileparts(result{1}), '\', '/');
    known = strcmp(pairs(:, 1), name);
    split = fullfile(folder, [suite.name '-' lower(strrep(name, '/', '-')) '-test']);
    if ~any(known)
      problems{end + 1} = sprintf('%s: %s has no case %s', result{1}, edition, name);
    elseif ~exist(fullfile(split, 'SHA256SUMS'), 'file')
      problems{end + 1} = sprintf('%s: missing; unpack its archive', split);
    else
      sums = regexp(fileread(fullfile(split, 'SHA256SUMS')), '[^\n]*  images/[^\n]*\n', 'match');
      if ~strcmp(sha256([sums{:}]), pairs{known, 2})
        problems{end + 1} = sprintf('%s: not the images of %s', split, edition);
      end
      manifest = jsondecode(fileread(fullfile(split, 'datapackage.json')));
      problems = [problems, problems_of(fullfile(results, result{1}), manifest.microsig)];
      files{end + 1} = result{1};
      is_there = is_there | known;
    end
  end
  if isempty(files)
    problems{end + 1} = sprintf('%s: no TRACK/CASE/results.csv', results);
  end
  if ~isempty(problems)
    error('%s', strjoin(problems, sprintf('\n')));
  end
  hashes = cellfun(@(name, hash) sprintf('"%s": "%s"', name, hash), pairs(is_there, 1), pairs(is_there, 2), 'UniformOutput', false);
  hashes = ['"images_sha256": {' strjoin(hashes', ', ') '}'];
  if isfield(about, 'images_sha256')
    text = regexprep(text, '"images_sha256"\s*:\s*\{[^}]*\}', hashes);
  else
    text = regexprep(text, '\}\s*$', [', ' hashes '}']);
  end
  if exist(fullfile(results, 'tracker.json'), 'file')
    files{end + 1} = 'tracker.json';
  end
  place = tempname();
  for file = files
    [~, ~] = mkdir(fullfile(place, fileparts(file{1})));
    copyfile(fullfile(results, file{1}), fullfile(place, file{1}));
  end
  written = fopen(fullfile(place, 'submission.json'), 'w', 'n', 'UTF-8');
  fprintf(written, '%s', text);
  fclose(written);
  if exist(out, 'file')
    delete(out);
  end
  zip(out, [{'submission.json'}, files], place);
  rmdir(place, 's');
  fprintf('%s: %d of %d cases\n', out, sum(is_there), numel(is_there));
  if ~all(is_there)
    fprintf('missing, behind all others: %s\n', strjoin(pairs(~is_there, 1)', ', '));
  end
  if isfield(suite, 'deadline') && ischar(suite.deadline)
    fprintf('deadline %s\n', suite.deadline);
  end
end

% TRACK/CASE/results.csv below a folder.
function files = found_in(results)
  files = {};
  for track = names_in(results)
    for name = names_in(fullfile(results, track{1}))
      file = fullfile(track{1}, name{1}, 'results.csv');
      if exist(fullfile(results, file), 'file')
        files{end + 1} = file;
      end
    end
  end
end

% Sorted names of the folders in a folder.
function names = names_in(folder)
  entries = dir(folder);
  names = sort({entries([entries.isdir]).name});
  names = names(~strncmp(names, '.', 1));
end

% What is wrong with a result, each with its line.
function problems = problems_of(result, facts)
  is_field = isfield(facts, 'scored') && ~any(strcmp(facts.scored, 'particles'));
  needed = {'frame', 'x_px', 'y_px'};
  counted = 'frame';
  last = facts.timing.frames;
  if is_field
    needed = {'x_px', 'y_px', 'dx_px', 'dy_px'};
    counted = 'pair';
    last = facts.timing.frames / 2;
  elseif isfield(facts, 'scoring') && isfield(facts.scoring, 'dims') && isequal(facts.scoring.dims, 3)
    needed{end + 1} = 'z_um';
  end
  problems = {};
  file = fopen(result, 'r');
  first = fgetl(file);
  header = strtrim(strsplit(first(first < 128), ','));   % without the mark of UTF-8
  rows = textscan(file, repmat('%q', 1, numel(header)), 'Delimiter', ',');
  fclose(file);
  for name = unique([needed, {counted}])
    at = find(strcmp(header, name{1}), 1);
    if isempty(at)
      if any(strcmp(needed, name{1}))
        problems{end + 1} = sprintf('%s:1: no column %s', result, name{1});
      end
      continue
    end
    cells = rows{at};
    values = str2double(cells);
    given = ~(cellfun(@isempty, cells) | strcmpi(cells, 'nan'));
    if strcmp(name{1}, counted)
      wrong = given & ~(values >= 0 & values < last & values == floor(values));
      expected = sprintf('0 to %d', last - 1);
    else
      wrong = given & isnan(values);
      expected = 'a number';
    end
    for line = find(wrong, 3)'
      problems{end + 1} = sprintf('%s:%d: %s = %s: expected %s', result, line + 1, name{1}, cells{line}, expected);
    end
  end
end

function text = sha256(bytes)
  if exist('OCTAVE_VERSION', 'builtin')
    text = hash('sha256', bytes);
  else
    digest = java.security.MessageDigest.getInstance('SHA-256');
    text = sprintf('%02x', typecast(digest.digest(uint8(bytes)), 'uint8'));
  end
end
