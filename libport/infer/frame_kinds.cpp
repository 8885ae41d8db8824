#include "libport/infer/frame_kinds.hpp"

#include <algorithm>
#include <map>
#include <numeric>
#include <set>
#include <tuple>

namespace porttape {
namespace {

bool is_letter(Byte byte) { return (byte >= 'a' && byte <= 'z') || (byte >= 'A' && byte <= 'Z'); }
bool is_mark(Byte byte) { return !is_letter(byte) && (byte < '0' || byte > '9'); }

Bytes text_key(const FrameSort& sort, ByteView body) {
  std::size_t size = sort.format.start.size();
  const auto more = [&](auto is) { return size < body.size() && is(body[size]); };
  if (sort.whole_words.empty()) {
    while (size < 4 && more(is_mark)) ++size;
  } else if (size < body.size() &&
             sort.whole_words.find(static_cast<char>(body[size])) == std::string::npos) {
    return {body.begin(), body.begin() + static_cast<std::ptrdiff_t>(size) + 1};
  }
  while (more(is_letter)) ++size;
  return {body.begin(), body.begin() + static_cast<std::ptrdiff_t>(size)};
}

Bytes key_of(const FrameSort& sort, ByteView body) {
  if (sort.text) return text_key(sort, body);
  if (sort.key_size == 0 || body.size() < sort.key_at + sort.key_size) return {};
  const ByteView key = body.subspan(sort.key_at, sort.key_size);
  return {key.begin(), key.end()};
}

double share(std::size_t part, std::size_t whole) {
  return whole == 0 ? 1 : static_cast<double>(part) / static_cast<double>(whole);
}

template <class Range>
double same_share(const Range& a, const Range& b) {
  const std::size_t size = std::min(a.size(), b.size());
  std::size_t same = 0;
  for (std::size_t i = 0; i < size; ++i) same += a[i] == b[i] ? 1U : 0U;
  return share(same, std::max(a.size(), b.size()));
}

// A frame as it is compared with others.
struct Face {
  std::size_t sort = 0;
  ByteView frame;
  Bytes body;  // with its counters at zero
  Bytes key;
  TextParts parts;  // of texts
  bool text = false;
  double weight = 1;  // one of few tells more of where it stands than one of many
};

double likeness(const Face& a, const Face& b) {
  if (a.sort != b.sort || (a.key != b.key)) return 0;
  if (std::ranges::equal(a.body, b.body)) return 1;
  if (a.text) {
    const bool marks = a.parts.marks == b.parts.marks;
    return marks ? 0.5 + 0.4 * same_share(a.parts.words, b.parts.words) : 0.3;
  }
  const double same = same_share(a.body, b.body);
  if (a.key.empty() && same < 0.4) return 0;
  return a.body.size() == b.body.size() ? 0.5 + 0.4 * same : 0.2 + 0.3 * same;
}

// What frames of one kind have in common, but where frames that were compared differ in it.
using Shape = std::tuple<std::size_t, Bytes, std::string>;  // sort, key, marks or size
Shape shape_of(const Face& face) {
  return {face.sort, face.key, face.text ? face.parts.marks : std::to_string(face.body.size())};
}

// By how often a frame's shape comes in its session; where no key is known, by how often the frame itself
// does.
void weigh(std::vector<Face>& faces) {
  std::map<Shape, std::size_t> counts;
  const auto known_by = [](const Face& face) {
    return face.key.empty() ? Shape{face.sort, Bytes(face.body.begin(), face.body.end()), {}}
                            : shape_of(face);
  };
  for (const Face& face : faces) ++counts[known_by(face)];
  for (Face& face : faces) {
    const auto count = static_cast<double>(counts[known_by(face)]);
    face.weight = 1 / (count * count);  // all together weigh less than one that is alone
  }
}

Bytes without_counters(const FoundSort& sort, ByteView body) {
  Bytes bytes(body.begin(), body.end());
  for (const FoundField& counter : sort.counters)
    std::fill_n(bytes.begin() + static_cast<std::ptrdiff_t>(counter.at), counter.size, Byte{0});
  return bytes;
}

std::vector<std::vector<Face>> faces_of(const Findings& findings, const SessionFrames& frames) {
  std::vector<std::vector<Face>> all;
  for (const auto& session : frames) {
    auto& faces = all.emplace_back();
    for (const Frame& frame : session) {
      const FoundSort& found = findings.sorts[frame.sort];
      const ByteView body = found.body(frame.bytes);
      faces.push_back({frame.sort, frame.bytes, without_counters(found, body), key_of(found.sort, body),
                       found.sort.text ? cut_text(as_text(body)) : TextParts{}, found.sort.text});
    }
    weigh(faces);
  }
  return all;
}

std::vector<Column> columns_by_likeness(const std::vector<std::vector<Face>>& faces) {
  std::vector<std::size_t> sizes;
  for (const auto& session : faces) sizes.push_back(session.size());
  return align_all(sizes, [&](std::size_t of_a, std::size_t a, std::size_t of_b, std::size_t b) {
    const Face& one = faces[of_a][a];
    const Face& other = faces[of_b][b];
    return likeness(one, other) * std::min(one.weight, other.weight);
  });
}

// Whether the byte at `at` is the same within each column, and is one of several over all of them.
bool tells_kinds(std::span<const Compared> columns, std::size_t at) {
  constexpr std::size_t kMostKinds = 16;
  std::set<Byte> values;
  for (const Compared& column : columns) {
    for (const ByteView frame : column)
      if (frame.size() <= at || frame[at] != column.front()[at]) return false;
    values.insert(column.front()[at]);
  }
  return values.size() > 1 && values.size() <= std::min(kMostKinds, columns.size() / 2);
}

// Among the first bytes those that tell kinds, up to the first that does not.
void find_key(FrameSort& sort, std::span<const Compared> columns) {
  constexpr std::size_t kMostAt = 8;
  for (std::size_t at = 0; at < kMostAt; ++at) {
    const auto length = static_cast<std::size_t>(sort.format.length.at);
    const bool in_length = sort.format.kind == FrameFormat::Kind::length && at >= length &&
                           at < length + static_cast<std::size_t>(sort.format.length.size);
    if (!in_length && tells_kinds(columns, at)) {
      if (sort.key_size == 0) sort.key_at = at;
      ++sort.key_size;
    } else if (sort.key_size > 0) {
      return;
    }
  }
}

// Sets that grow together.
class Unions {
 public:
  explicit Unions(std::size_t size) : parents_(size) { std::iota(parents_.begin(), parents_.end(), 0U); }
  std::size_t root(std::size_t item) {
    while (parents_[item] != item) item = parents_[item] = parents_[parents_[item]];
    return item;
  }
  void join(std::size_t a, std::size_t b) { parents_[root(a)] = root(b); }

 private:
  std::vector<std::size_t> parents_;
};

// Takes one more face into what a kind has in common.
void take(KindColumns& into, const Face& face, const FrameSort& sort, bool first) {
  FoundKind& kind = into.kind;
  const std::size_t size = face.frame.size();
  if (first) {
    kind.sort = face.sort;
    kind.key = face.key;
    kind.key_at = face.text ? 0 : sort.key_at;
    if (face.text) {
      kind.marks = face.parts.marks;
    } else {
      kind.size = size;
    }
    return;
  }
  const auto differing = std::ranges::mismatch(kind.key, face.key).in1;
  kind.key.erase(differing, kind.key.end());
  if (kind.size && *kind.size != size) kind.size.reset();
  if (kind.marks && *kind.marks != face.parts.marks) kind.marks.reset();
}

}  // namespace

std::vector<Compared> columns_of(const std::vector<Column>& columns, const SessionFrames& frames,
                                 std::size_t sort) {
  std::vector<Compared> all;
  for (const Column& column : columns) {
    Compared compared;
    for (std::size_t session = 0; session < column.size(); ++session) {
      if (!column[session]) continue;
      const Frame& frame = frames[session][*column[session]];
      if (frame.sort == sort) compared.push_back(frame.bytes);
    }
    if (compared.size() > 1) all.push_back(std::move(compared));
  }
  return all;
}

std::vector<Column> find_columns(Findings& findings, const SessionFrames& frames) {
  std::vector<Column> columns = columns_by_likeness(faces_of(findings, frames));
  bool found = false;
  for (std::size_t sort = 0; sort < findings.sorts.size(); ++sort) {
    FrameSort& each = findings.sorts[sort].sort;
    if (each.text || each.key_size > 0) continue;
    find_key(each, columns_of(columns, frames, sort));
    found = found || each.key_size > 0;
  }
  return found ? columns_by_likeness(faces_of(findings, frames)) : columns;
}

std::vector<KindColumns> find_kinds(const Findings& findings, const SessionFrames& frames,
                                    const std::vector<Column>& columns) {
  const auto faces = faces_of(findings, frames);
  std::map<Shape, std::size_t> shapes;
  for (const auto& session : faces)
    for (const Face& face : session) shapes.emplace(shape_of(face), shapes.size());
  Unions unions(shapes.size());
  for (const Column& column : columns) {
    std::optional<std::size_t> first;
    for (std::size_t session = 0; session < column.size(); ++session) {
      if (!column[session]) continue;
      const std::size_t shape = shapes.at(shape_of(faces[session][*column[session]]));
      if (first) unions.join(*first, shape);
      first = shape;
    }
  }
  std::map<std::size_t, std::size_t> places;  // in `kinds`, by root
  std::vector<KindColumns> kinds;
  for (const Column& column : columns) {
    Compared compared;
    KindColumns* kind = nullptr;
    for (std::size_t session = 0; session < column.size(); ++session) {
      if (!column[session]) continue;
      const Face& face = faces[session][*column[session]];
      const auto [place, is_new] = places.emplace(unions.root(shapes.at(shape_of(face))), kinds.size());
      if (is_new) kinds.emplace_back().kind.runs.resize(frames.size());
      kind = &kinds[place->second];
      take(*kind, face, findings.sorts[face.sort].sort, is_new);
      kind->kind.runs[session].push_back(face.frame);
      compared.push_back(face.frame);
    }
    const bool full = compared.size() == frames.size();
    if (!full) kind->kind.alone.insert(kind->kind.alone.end(), compared.begin(), compared.end());
    kind->kind.in_all = kind->kind.in_all || full;
    if (compared.size() > 1) kind->columns.push_back(std::move(compared));
  }
  return kinds;
}

}  // namespace porttape
