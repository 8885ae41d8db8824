#include "libport/pack/make_pack.hpp"

#include <algorithm>
#include <utility>

#include "libport/base/printable.hpp"
#include "libport/pack/tape_folder.hpp"
#include "libport/tape/judgement.hpp"
#include "libport/tape/new_file.hpp"
#include "libport/tape/payload_totals.hpp"
#include "libport/tape/stored_bytes.hpp"
#include "libport/tape/tape_header.hpp"
#include "libport/tape/tape_lock.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kReadAtOnce = std::size_t{256} * 1024;

std::string folder_in(const fs::path& file) {
  std::string name = file.filename().string();
  for (const std::string_view ending : {".tar.zst", ".tar.gz", ".tgz", ".tzst", ".zst", ".gz", ".tar"}) {
    if (name.size() > ending.size() && name.ends_with(ending)) {
      name.resize(name.size() - ending.size());
      break;
    }
  }
  return is_plain_name(name) ? name : "pack";
}

// What was never written is no recording, and a terabyte of it would be read twice.
Result<void> check_written(FileSource& source) {
  const Result<std::uint64_t> size = source.size();
  if (!size) return size.error();
  if (!StoredBytes(source).has_hole(0, *size)) return {};
  return make_error(Errc::damaged_tape,
                    in_quotes(source.name()) + " has a hole: a part of it was never written");
}

class PackMaker {
 public:
  PackMaker(const fs::path& file, const PackOptions& options)
      : file_(file), options_(options), manifest_(options.about), buffer_(kReadAtOnce) {
    TapeHeader now = completed(TapeHeader{});
    manifest_.created = now.created;
    manifest_.tool = now.tool;
  }

  Result<void> add(const TapePaths& tape) {
    const std::string name = tape.file_name();
    if (!is_plain_name(name))
      return make_error(Errc::usage,
                        "tape " + in_quotes(tape.name()) + " has a name that cannot be packed: " +
                            "a . or - at its beginning, control characters, a backslash or no UTF-8; "
                            "rename its files");
    for (const PackedTape& other : manifest_.tapes) {
      if (other.name == name)
        return make_error(Errc::usage,
                          "two tapes are called " + in_quotes(name) + "; rename one, or make two packs");
    }
    std::vector<std::unique_ptr<FileSource>> files;
    Result<TapeSources> sources = open_files(tape, files);
    if (!sources) return sources.error();
    const Result<TapeSummary> summary = summarize(tape.name(), std::move(*sources));
    if (!summary) return summary.error();
    PackedTape packed{.name = name, .verdict = std::string(to_string(judge(*summary).verdict))};
    if (summary->events.header) packed.id = summary->events.header->id;
    for (std::unique_ptr<FileSource>& file : files) {
      std::string file_name = fs::path(file->name()).filename().string();
      if (Result<void> added = add_file(std::move(file), file_name); !added) return added;
      packed.files.push_back(std::move(file_name));
    }
    manifest_.tapes.push_back(std::move(packed));
    return {};
  }

  Result<void> add_redaction(const fs::path& path) {
    Result<std::unique_ptr<FileSource>> file = FileSource::open(path);
    if (!file) return file.error();
    if (Result<void> added = add_file(std::move(*file), std::string(kRedactionName)); !added) return added;
    ByteSource& source = *sources_.back();
    std::string head(200, '\0');
    const Result<std::size_t> read = source.read_at(0, {reinterpret_cast<Byte*>(head.data()), head.size()});
    if (!read) return read.error();
    head.resize(*read);
    if (!head.starts_with(R"({"format":"porttape-redaction")"))
      return make_error(Errc::usage,
                        in_quotes(path.string()) + " is no report of porttape redact --report FILE");
    manifest_.redaction = true;
    return {};
  }

  Result<PackManifest> write() {
    Result<NewFile> file = NewFile::create(file_.string(), options_.overwrite);
    if (!file) return file.error();
    for (const auto& source : sources_) {
      if (Result<void> made = file->made_of(source->fd()); !made) return made.error();
    }
    Result<PackWriter> writer = PackWriter::begin([&](ByteView bytes) { return file->add(bytes); },
                                                  pack_format_of(file_), folder_in(file_));
    if (!writer) return writer.error();
    const std::string about = to_json(manifest_);
    Result<void> done = writer->begin_file(std::string(kManifestName), about.size());
    if (done) done = writer->write(as_bytes(about));
    for (std::size_t i = 0; done && i < sources_.size(); ++i) {
      done = writer->begin_file(manifest_.files[i].name, manifest_.files[i].size);
      if (done) done = copy(i, *writer);
    }
    if (done) done = writer->finish();
    if (!done) return done.error();
    if (Result<void> published = file->finish(); !published) return published.error();
    return std::move(manifest_);
  }

 private:
  // Opens each file of the tape once, into `files`. All that is told of a file and packed of it is read from
  // there: somebody else may exchange the file of that name meanwhile.
  static Result<TapeSources> open_files(const TapePaths& tape,
                                        std::vector<std::unique_ptr<FileSource>>& files) {
    const Result<TapeFolder> folder = TapeFolder::open(tape);
    if (!folder) return folder.error();
    return TapeSources::open(tape, [&](const fs::path& path) -> Result<std::unique_ptr<ByteSource>> {
      Result<std::unique_ptr<FileSource>> file = folder->open_file(path);
      if (!file) return file.error();
      if (!*file) return std::unique_ptr<ByteSource>();
      if (is_being_written((*file)->fd()))
        return make_error(Errc::usage, "tape " + in_quotes(tape.name()) +
                                           " is being written; wait for its end, or " +
                                           "begin the next one by porttape ctl rotate");
      if (Result<void> written = check_written(**file); !written) return written.error();
      Result<std::unique_ptr<FileSource>> same = (*file)->duplicate();
      if (!same) return same.error();
      files.push_back(std::move(*file));
      return std::unique_ptr<ByteSource>(std::move(*same));
    });
  }

  Result<void> add_file(std::unique_ptr<FileSource> source, const std::string& name) {
    const Result<std::uint64_t> size = source->size();
    if (!size) return size.error();
    PackedFile file{.name = name, .size = *size};
    Result<std::uint64_t> digest = read_all(*source, *size, [](ByteView) { return Result<void>(); });
    if (!digest) return digest.error();
    file.xxh3 = *digest;
    manifest_.files.push_back(std::move(file));
    sources_.push_back(std::move(source));
    return {};
  }

  Result<void> copy(std::size_t number, PackWriter& writer) {
    const PackedFile& file = manifest_.files[number];
    const Result<std::uint64_t> digest =
        read_all(*sources_[number], file.size, [&](ByteView bytes) { return writer.write(bytes); });
    if (!digest) return digest.error();
    if (*digest == file.xxh3) return {};
    return make_error(Errc::io, in_quotes(sources_[number]->name()) + " was changed meanwhile");
  }

  template <class Take>
  Result<std::uint64_t> read_all(ByteSource& source, std::uint64_t size, const Take& take) {
    PayloadCounter digest;
    for (std::uint64_t at = 0; at < size;) {
      const std::size_t want = static_cast<std::size_t>(std::min<std::uint64_t>(size - at, buffer_.size()));
      const Result<std::size_t> read = source.read_at(at, std::span(buffer_).first(want));
      if (!read) return read.error();
      if (*read == 0) return make_error(Errc::io, in_quotes(source.name()) + " became shorter meanwhile");
      const ByteView bytes = ByteView(buffer_).first(*read);
      digest.add(bytes);
      if (Result<void> taken = take(bytes); !taken) return taken.error();
      at += *read;
      if (options_.progress) options_.progress(bytes_ += *read);
    }
    return *digest.totals().xxh3;
  }

  const fs::path& file_;
  const PackOptions& options_;
  PackManifest manifest_;
  std::vector<std::unique_ptr<FileSource>> sources_;
  Bytes buffer_;
  std::uint64_t bytes_ = 0;
};

}  // namespace

PackFormat pack_format_of(const fs::path& file) {
  const std::string ending = file.extension().string();
  return ending == ".gz" || ending == ".tgz" ? PackFormat::gzip : PackFormat::zstd;
}

Result<PackManifest> make_pack(const std::vector<TapePaths>& tapes, const fs::path& file,
                               const PackOptions& options) {
  if (const Result<NewFile> possible = NewFile::create(file.string(), options.overwrite); !possible)
    return possible.error();
  PackMaker maker(file, options);
  for (const TapePaths& tape : tapes) {
    if (Result<void> added = maker.add(tape); !added) return added.error();
  }
  if (options.redaction) {
    if (Result<void> added = maker.add_redaction(*options.redaction); !added) return added.error();
  }
  return maker.write();
}

}  // namespace porttape
