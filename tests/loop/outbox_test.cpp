#include "libport/loop/outbox.hpp"

#include <cerrno>
#include <fcntl.h>
#include <memory>
#include <string>
#include <string_view>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/refused_calls.hpp"

namespace porttape {
namespace {

// One end of a pair of sockets with an outbox, and the other end.
class OutboxTest : public testing::TestWithParam<Outbox::Kind> {
 protected:
  OutboxTest() {
    int ends[2];
    EXPECT_EQ(::socketpair(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0, ends), 0);
    near.reset(ends[0]);
    far.reset(ends[1]);
    watch = std::make_unique<FdWatch>(
        loop, near.get(), [] {}, [this] { outbox->flush(); });
    outbox = std::make_unique<Outbox>(
        near.get(), GetParam(), *watch, [this] { ++drained; },
        [this](int number, std::size_t bytes) {
          error = number;
          lost += bytes;
        });
  }
  // Writes until the kernel takes no more; all that was written.
  std::string fill() {
    std::string all;
    for (char letter = 'a'; !outbox->congested();
         letter = letter == 'z' ? 'a' : static_cast<char>(letter + 1)) {
      const std::string block(10'007, letter);
      outbox->write(as_bytes(block));
      all += block;
    }
    return all;
  }
  // What the peer can read now.
  std::string read() const {
    std::string all;
    std::string block(65536, '\0');
    for (ssize_t n = 0; (n = ::read(far.get(), block.data(), block.size())) > 0;)
      all.append(block, 0, static_cast<std::size_t>(n));
    return all;
  }

  // Notes, when it is called, what has been sent before it: "EVENT@BYTES", or "EVENT dropped".
  Outbox::Event event(const std::string& name) {
    return [this, name](Outbox::Turn turn) {
      came += read();
      events += name + (turn == Outbox::Turn::now ? "@" + std::to_string(came.size()) : " dropped") + " ";
      return true;
    };
  }
  // Turns the loop until all is sent; `came` has then what the peer read.
  void send_all() {
    run_until(loop, [this] {
      came += read();
      return drained > 0 || lost > 0;
    });
    came += read();
  }

  Loop loop;
  UniqueFd near;
  UniqueFd far;
  std::string came;
  std::string events;
  std::unique_ptr<FdWatch> watch;
  std::unique_ptr<Outbox> outbox;
  int drained = 0;
  int error = 0;
  std::size_t lost = 0;
};
INSTANTIATE_TEST_SUITE_P(Kinds, OutboxTest, testing::Values(Outbox::Kind::file, Outbox::Kind::socket),
                         [](const auto& of) { return of.param == Outbox::Kind::file ? "file" : "socket"; });

TEST_P(OutboxTest, WhatTheKernelTakesIsSentAtOnce) {
  outbox->write(as_bytes("one"));
  outbox->write(as_bytes("two"));
  EXPECT_FALSE(outbox->congested());
  EXPECT_EQ(outbox->pending(), 0U);
  EXPECT_EQ(read(), "onetwo");
  loop.poll_one();
  EXPECT_EQ(drained, 0) << "it was never congested";
}

TEST_P(OutboxTest, WhatItDoesNotTakeIsKeptAndSentInOrder) {
  std::string all = fill();
  const std::size_t kept = outbox->pending();
  EXPECT_GT(kept, 0U);
  outbox->write(as_bytes("behind"));
  all += "behind";
  EXPECT_EQ(outbox->pending(), kept + 6) << "nothing overtakes what is kept";
  send_all();
  EXPECT_EQ(came, all);
  EXPECT_EQ(outbox->pending(), 0U);
  EXPECT_FALSE(outbox->congested());
  outbox->write(as_bytes("again"));
  EXPECT_EQ(read(), "again");
  EXPECT_EQ(drained, 1);
  EXPECT_EQ(lost, 0U);
}

TEST_P(OutboxTest, SomeKeepsNothingAndTellsWhenThereIsRoom) {
  EXPECT_EQ(outbox->write_some(as_bytes("all")), 3U);
  std::string all = "all";
  const std::string block(100'000, 'b');
  std::size_t taken = 0;
  do {
    taken = outbox->write_some(as_bytes(block));
    all += block.substr(0, taken);
  } while (taken == block.size());
  EXPECT_EQ(outbox->write_some(as_bytes(block)), 0U);
  EXPECT_FALSE(outbox->congested());
  EXPECT_EQ(outbox->pending(), 0U);
  send_all();
  EXPECT_EQ(came, all);
}

TEST_P(OutboxTest, SomeThatIsTakenWholeWaitsForNoRoom) {
  EXPECT_EQ(outbox->write_some(as_bytes("all")), 3U);
  while (loop.poll_one()) {
  }
  EXPECT_EQ(drained, 0);
  EXPECT_EQ(read(), "all");
}

TEST_P(OutboxTest, SomeDoesNotOvertakeWhatIsKept) {
  const std::string all = fill();
  came = read();  // there is room, and the loop has not seen it
  EXPECT_EQ(outbox->write_some(as_bytes("x")), 0U);
  send_all();
  EXPECT_EQ(came, all);
}

TEST_P(OutboxTest, WhatIsDiscardedIsNotSent) {
  const std::string all = fill();
  const std::size_t kept = outbox->pending();
  outbox->discard();
  EXPECT_FALSE(outbox->congested());
  EXPECT_EQ(outbox->pending(), 0U);
  came = read();
  EXPECT_EQ(came.size(), all.size() - kept);
  while (loop.poll_one()) {
  }
  EXPECT_EQ(drained, 0);
  EXPECT_EQ(read(), "");
}

// The call that sends, refused with this error: 0 means that it sends nothing.
test::RefusedCall refused_send(int fd, Outbox::Kind kind, int error) {
  return test::refused_on(fd, kind == Outbox::Kind::file ? SYS_write : SYS_sendto, error);
}

TEST_P(OutboxTest, WhatTheKernelHasNoRoomOrMemoryForIsKeptAndSentLater) {
  for (const int why : {EAGAIN, ENOMEM, ENOBUFS, 0}) {
    drained = 0;
    loop.restart();
    EXPECT_TRUE(test::while_refused({refused_send(near.get(), GetParam(), why)}, [&] {
      errno = EIO;  // of an earlier call
      outbox->write(as_bytes("kept"));
      EXPECT_EQ(outbox->pending(), 4U) << why;
      outbox->write(as_bytes(", too"));
      EXPECT_EQ(outbox->write_some(as_bytes("not taken")), 0U);
      for (int n = 0; n < 10; ++n) loop.poll_one();
      EXPECT_EQ(outbox->pending(), 9U) << why;
    }));
    EXPECT_EQ(drained, 0);
    run_until(loop, [this] { return drained > 0 || lost > 0; });
    EXPECT_EQ(read(), "kept, too");
    EXPECT_EQ(outbox->pending(), 0U);
    EXPECT_EQ(error, 0) << why;
    EXPECT_EQ(lost, 0U);
  }
}

TEST_P(OutboxTest, OneByteThatIsLeftIsSentAsWell) {
  EXPECT_TRUE(test::while_refused({refused_send(near.get(), GetParam(), EAGAIN)},
                                  [&] { outbox->write(as_bytes("x")); }));
  EXPECT_TRUE(outbox->congested());
  run_until(loop, [this] { return drained > 0 || lost > 0; });
  EXPECT_EQ(read(), "x");
}

TEST_P(OutboxTest, WhatFailsForAnotherReasonIsToldWithItsBytesUntilANewBeginning) {
  for (const int why : {EPERM, EIO, ENOSPC, ECONNRESET, ENETUNREACH, EPIPE}) {
    error = 0;
    lost = 0;
    EXPECT_TRUE(test::while_refused({refused_send(near.get(), GetParam(), why)}, [&] {
      outbox->write(as_bytes("four"));
      EXPECT_EQ(outbox->write_some(as_bytes("x")), 1U) << "nobody is to wait for it";
    }));
    EXPECT_EQ(error, why);
    EXPECT_EQ(lost, 5U);
    EXPECT_FALSE(outbox->congested());
    outbox->discard();
    outbox->write(as_bytes("again"));
    EXPECT_EQ(read(), "again");
  }
  EXPECT_EQ(drained, 0);
}

TEST_P(OutboxTest, WhatWasKeptAndThenFailsIsToldOnce) {
  EXPECT_TRUE(test::while_refused({refused_send(near.get(), GetParam(), EAGAIN)},
                                  [&] { outbox->write(as_bytes("four")); }));
  EXPECT_TRUE(test::while_refused({refused_send(near.get(), GetParam(), EIO)}, [&] {
    run_until(loop, [this] { return error != 0; });
    for (int n = 0; n < 10; ++n) loop.poll_one();
  }));
  EXPECT_EQ(error, EIO);
  EXPECT_EQ(lost, 4U);
  EXPECT_EQ(outbox->pending(), 0U);
  EXPECT_EQ(drained, 0) << "nothing was sent";
}

std::string at(const std::string& name, std::size_t bytes) {
  return name + "@" + std::to_string(bytes) + " ";
}

TEST_P(OutboxTest, AnEventIsCalledAtOnceWhereNothingIsPending) {
  outbox->put(event("first"));
  EXPECT_EQ(events, "first@0 ");
  outbox->write(as_bytes("one"));
  outbox->put(event("second"));
  outbox->put(event("third"));
  EXPECT_EQ(events, "first@0 second@3 third@3 ");
  EXPECT_FALSE(outbox->congested());
  while (loop.poll_one()) {
  }
  EXPECT_EQ(drained, 0) << "it was never congested";
}

TEST_P(OutboxTest, EventsAmongKeptBytesAreCalledAtTheirPlaces) {
  std::string all = fill();
  outbox->put(event("one"));
  outbox->put(event("two"));
  outbox->write(as_bytes("between"));
  outbox->put(event("three"));
  outbox->write(as_bytes("behind"));
  while (loop.poll_one()) {
  }
  EXPECT_EQ(events, "") << "the kernel has no room";
  send_all();
  EXPECT_EQ(events, at("one", all.size()) + at("two", all.size()) + at("three", all.size() + 7));
  EXPECT_EQ(came, all + "betweenbehind");
  EXPECT_FALSE(outbox->congested());
  EXPECT_EQ(drained, 1);
}

TEST_P(OutboxTest, AnEventDoesNotWaitForWhatIsWrittenBehindIt) {
  std::string all = fill();
  outbox->put(event("drain"));
  const std::string behind(std::size_t{4} << 20, 'x');
  outbox->write(as_bytes(behind));
  run_until(loop, [this] {
    came += read();
    return !events.empty();
  });
  EXPECT_EQ(events, at("drain", all.size()));
  EXPECT_TRUE(outbox->congested());
  EXPECT_EQ(drained, 0);
  send_all();
  EXPECT_EQ(came, all + behind);
  EXPECT_EQ(events, at("drain", all.size())) << "once";
}

TEST_P(OutboxTest, AnEventWithoutRoomIsCalledAgainAndNothingOvertakesIt) {
  for (const bool kept : {false, true}) {
    came.clear();
    events.clear();
    drained = 0;
    const std::string all = kept ? fill() : "";
    int calls = 0;
    outbox->put([this, &calls](Outbox::Turn turn) { return ++calls == 3 && event("urgent")(turn); });
    outbox->put(event("next"));
    outbox->write(as_bytes("behind"));
    EXPECT_TRUE(outbox->congested());
    EXPECT_EQ(outbox->write_some(as_bytes("not taken")), 0U);
    EXPECT_EQ(events, "");
    EXPECT_EQ(calls, kept ? 0 : 1);
    send_all();
    EXPECT_EQ(calls, 3);
    EXPECT_EQ(events, at("urgent", all.size()) + at("next", all.size()));
    EXPECT_EQ(came, all + "behind");
  }
}

TEST_P(OutboxTest, AnEventAloneThatFindsNoRoomIsDrainedToo) {
  int calls = 0;
  outbox->put([&calls](Outbox::Turn) { return ++calls == 2; });
  EXPECT_TRUE(outbox->congested());
  EXPECT_EQ(outbox->pending(), 0U);
  run_until(loop, [this] { return drained > 0; });
  EXPECT_EQ(calls, 2);
  EXPECT_FALSE(outbox->congested());
}

TEST_P(OutboxTest, AnEventThatWritesIsBeforeWhatWasWrittenBehindIt) {
  const std::string all = fill();
  outbox->put([this](Outbox::Turn) {
    outbox->write(as_bytes("last,"));
    outbox->put(event("last"));
    return true;
  });
  outbox->write(as_bytes("behind,"));
  outbox->put([this](Outbox::Turn) {
    outbox->write(as_bytes("very last"));
    outbox->put(event("very last"));
    return true;
  });
  send_all();
  EXPECT_EQ(came, all + "behind,last,very last");
  EXPECT_EQ(events, at("last", all.size() + 12) + at("very last", all.size() + 21));
  EXPECT_EQ(drained, 1);
}

TEST_P(OutboxTest, AnEventBehindSomeThatWasTakenDoesNotWaitForTheRest) {
  const std::string block(100'000, 'b');
  std::string all;
  std::size_t taken = 0;
  do {
    taken = outbox->write_some(as_bytes(block));
    all += block.substr(0, taken);
  } while (taken == block.size());
  outbox->put(event("drain"));
  EXPECT_EQ(events, at("drain", all.size()));
  EXPECT_FALSE(outbox->congested());
  send_all();
  EXPECT_EQ(came, all);
  EXPECT_EQ(drained, 1) << "there is room for more";
}

TEST_P(OutboxTest, DiscardedEventsAreToldOnce) {
  (void)fill();
  outbox->put(event("one"));
  outbox->write(as_bytes("between"));
  outbox->put(event("two"));
  outbox->discard();
  EXPECT_EQ(events, "one dropped two dropped ");
  EXPECT_FALSE(outbox->congested());
  outbox->discard();
  while (loop.poll_one()) {
  }
  EXPECT_EQ(events, "one dropped two dropped ");
  EXPECT_EQ(drained, 0);
  events.clear();
  came.clear();
  outbox->put(event("new"));
  EXPECT_EQ(events, at("new", came.size())) << "a new beginning";
}

TEST_P(OutboxTest, AnEventThatDiscardsEndsTheFlush) {
  const std::string all = fill();
  outbox->put([this](Outbox::Turn) {
    outbox->discard();
    return true;
  });
  outbox->write(as_bytes("behind"));
  outbox->put(event("behind"));
  run_until(loop, [this] {
    came += read();
    return !events.empty();
  });
  EXPECT_EQ(events, "behind dropped ");
  while (loop.poll_one()) {
  }
  EXPECT_EQ(came + read(), all);
  EXPECT_EQ(drained, 0) << "nothing waits for it any more";
}

TEST_P(OutboxTest, EventsBehindBytesThatFailAreToldOnceBehindTheError) {
  EXPECT_TRUE(test::while_refused({refused_send(near.get(), GetParam(), EAGAIN)}, [&] {
    outbox->write(as_bytes("four"));
    outbox->put([this](Outbox::Turn turn) {
      EXPECT_EQ(error, EIO);
      return event("one")(turn);
    });
    outbox->write(as_bytes("behind"));
    outbox->put(event("two"));
  }));
  EXPECT_TRUE(test::while_refused({refused_send(near.get(), GetParam(), EIO)}, [&] {
    run_until(loop, [this] { return error != 0; });
    for (int n = 0; n < 10; ++n) loop.poll_one();
  }));
  EXPECT_EQ(events, "one dropped two dropped ");
  EXPECT_EQ(lost, 10U) << "what was behind the first event, too";
  EXPECT_EQ(drained, 0);
  outbox->put(event("three"));
  EXPECT_EQ(events, "one dropped two dropped three dropped ") << "until a new beginning";
  outbox->discard();
  outbox->put(event("four"));
  EXPECT_EQ(events, "one dropped two dropped three dropped four@0 ");
}

// A file's broken pipe is a signal.
class BrokenOutboxTest : public OutboxTest {};
INSTANTIATE_TEST_SUITE_P(OfSockets, BrokenOutboxTest, testing::Values(Outbox::Kind::socket));

TEST_P(BrokenOutboxTest, TellsWhatItCostAndKeepsNothing) {
  (void)fill();
  const std::size_t kept = outbox->pending();
  far.reset();
  while (error == 0) loop.run_one();
  EXPECT_TRUE(error == EPIPE || error == ECONNRESET) << error;
  EXPECT_EQ(lost, kept);
  EXPECT_FALSE(outbox->congested());
  EXPECT_EQ(drained, 0) << "until discard() makes a new beginning";
  outbox->write(as_bytes("more"));
  EXPECT_EQ(lost, kept + 4);
  EXPECT_EQ(outbox->pending(), 0U);
}

TEST(Outbox, DrainsAgainAfterAnErrorAndANewBeginning) {
  Loop loop;
  const UniqueFd fd(::open("/dev/full", O_WRONLY | O_CLOEXEC));
  int error = 0;
  std::size_t lost = 0;
  bool drained = false;
  Outbox* flushed = nullptr;
  FdWatch watch(
      loop, fd.get(), [] {}, [&flushed] { flushed->flush(); });
  Outbox outbox(
      fd.get(), Outbox::Kind::file, watch, [&drained] { drained = true; },
      [&](int number, std::size_t bytes) {
        error = number;
        lost += bytes;
      });
  flushed = &outbox;
  outbox.write(as_bytes("lost"));
  EXPECT_EQ(error, ENOSPC);
  EXPECT_EQ(lost, 4U);

  int ends[2];
  ASSERT_EQ(::socketpair(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0, ends), 0);
  const UniqueFd near(ends[0]);
  const UniqueFd far(ends[1]);
  ASSERT_GE(::dup2(near.get(), fd.get()), 0);
  outbox.discard();
  const std::string block(65536, 'b');
  while (!outbox.congested()) outbox.write(as_bytes(block));
  const Reader reader(loop, far.get());
  run_until(loop, [&] { return drained; });
  EXPECT_EQ(lost, 4U);
}

TEST_P(OutboxTest, ASingleByteIsSentOnce) {
  for (const std::string_view byte : {"a", "b"}) outbox->write(as_bytes(byte));
  EXPECT_EQ(outbox->write_some(as_bytes("c")), 1U);
  EXPECT_FALSE(outbox->congested());
  loop.poll_one();
  EXPECT_EQ(read(), "abc");
}

}  // namespace
}  // namespace porttape
