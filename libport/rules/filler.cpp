#include "libport/rules/filler.hpp"

#include <algorithm>
#include <bit>
#include <string_view>

namespace porttape {
namespace {

constexpr std::string_view kDigits = "0123456789";
constexpr std::string_view kUpper = "ABCDEFGHIJKLMNOPQRSTUVWXYZ";
constexpr std::string_view kLower = "abcdefghijklmnopqrstuvwxyz";
constexpr std::string_view kHexUpper = "0123456789ABCDEF";
constexpr std::string_view kHexLower = "0123456789abcdef";

bool is_in(std::string_view alphabet, Byte byte) {
  return alphabet.find(static_cast<char>(byte)) != std::string_view::npos;
}

struct SipState {
  std::uint64_t v0, v1, v2, v3;

  void round() {
    v0 += v1;
    v1 = std::rotl(v1, 13) ^ v0;
    v0 = std::rotl(v0, 32);
    v2 += v3;
    v3 = std::rotl(v3, 16) ^ v2;
    v0 += v3;
    v3 = std::rotl(v3, 21) ^ v0;
    v2 += v1;
    v1 = std::rotl(v1, 17) ^ v2;
    v2 = std::rotl(v2, 32);
  }
  void take(std::uint64_t word) {
    v3 ^= word;
    round();
    round();
    v0 ^= word;
  }
};

std::uint64_t little_endian(ByteView bytes) {
  std::uint64_t word = 0;
  for (std::size_t i = 0; i < bytes.size(); ++i) word |= std::uint64_t{bytes[i]} << (8 * i);
  return word;
}

// What a byte may become; empty: it stays.
std::string_view alphabet_like(Byte byte) {
  for (const std::string_view alphabet : {kDigits, kUpper, kLower}) {
    if (is_in(alphabet, byte)) return alphabet;
  }
  return {};
}

}  // namespace

std::uint64_t sip_hash(const Filler::Key& key, ByteView data) {
  SipState state{key[0] ^ 0x736f6d6570736575U, key[1] ^ 0x646f72616e646f6dU, key[0] ^ 0x6c7967656e657261U,
                 key[1] ^ 0x7465646279746573U};
  const std::uint64_t size = std::uint64_t{data.size()} << 56;
  for (; data.size() >= 8; data = data.subspan(8)) state.take(little_endian(data.first(8)));
  state.take(size | little_endian(data));
  state.v2 ^= 0xff;
  for (int i = 0; i < 4; ++i) state.round();
  return state.v0 ^ state.v1 ^ state.v2 ^ state.v3;
}

Filler::Filler(Key key, const std::vector<FrameFormat>& formats) : key_(key) {
  std::array<bool, 256> delimits{};
  for (const FrameFormat& format : formats) {
    for (const Byte byte : format.start) delimits[byte] = true;
    for (const Byte byte : format.end) delimits[byte] = true;
  }
  for (std::size_t byte = 0; byte < delimits.size(); ++byte) {
    if (!delimits[byte]) plain_.push_back(static_cast<Byte>(byte));
  }
  if (plain_.size() < 2) {
    plain_.resize(256);
    for (std::size_t byte = 0; byte < 256; ++byte) plain_[byte] = static_cast<Byte>(byte);
  }
}

Bytes Filler::fill(const RedactRule& rule, ByteView secret, bool text) const {
  const auto is_ascii = [](Byte byte) { return byte >= 0x20 && byte < 0x7f; };
  FillerKind kind = rule.filler;
  const bool plain_constant = std::all_of(rule.with.begin(), rule.with.end(), is_ascii);
  if (kind == FillerKind::constant && (plain_constant || !text)) {
    Bytes filler(secret.size());
    for (std::size_t i = 0; i < filler.size(); ++i) filler[i] = rule.with[i % rule.with.size()];
    return filler;
  }
  if (kind == FillerKind::like) {
    if (!std::all_of(secret.begin(), secret.end(), is_ascii)) {
      kind = FillerKind::bytes;
    } else if (std::all_of(secret.begin(), secret.end(),
                           [](Byte byte) { return alphabet_like(byte).empty(); })) {
      kind = FillerKind::letters;
    }
  }
  if (text && (kind == FillerKind::bytes || kind == FillerKind::constant)) kind = FillerKind::letters;
  return of_alphabet(kind, secret);
}

Bytes Filler::of_alphabet(FillerKind kind, ByteView secret) const {
  const bool lower = std::any_of(secret.begin(), secret.end(), [](Byte byte) { return is_in(kLower, byte); });
  const auto alphabet_of = [&](Byte byte) -> std::string_view {
    if (kind == FillerKind::like) return alphabet_like(byte);
    if (kind == FillerKind::digits) return kDigits;
    if (kind == FillerKind::letters) return lower ? kLower : kUpper;
    if (kind == FillerKind::hex) return lower ? kHexLower : kHexUpper;
    return as_text(plain_);
  };
  Bytes seed(4);
  seed.insert(seed.end(), secret.begin(), secret.end());
  const Key mine = {sip_hash(key_, seed), sip_hash({key_[1], key_[0]}, seed)};
  Bytes filler(secret.begin(), secret.end());
  std::size_t changed = filler.size();  // the last that may become another
  for (std::size_t i = 0; i < filler.size(); ++i) {
    const std::string_view alphabet = alphabet_of(secret[i]);
    if (alphabet.empty()) continue;
    const std::uint64_t place[] = {i};
    const std::uint64_t number =
        sip_hash(mine, ByteView(reinterpret_cast<const Byte*>(place), sizeof place)) % alphabet.size();
    filler[i] = static_cast<Byte>(alphabet[number]);
    changed = i;
  }
  if (changed < filler.size() && std::equal(filler.begin(), filler.end(), secret.begin())) {
    const std::string_view alphabet = alphabet_of(secret[changed]);
    const std::size_t at = alphabet.find(static_cast<char>(filler[changed]));
    filler[changed] = static_cast<Byte>(alphabet[(at + 1) % alphabet.size()]);
  }
  return filler;
}

}  // namespace porttape
