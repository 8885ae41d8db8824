#include "daemon/log_queue.hpp"

#include <condition_variable>
#include <mutex>
#include <string>

#include <gtest/gtest.h>

namespace porttape {
namespace {

// What a target got, and whether it takes anything; shared with the queue's thread.
struct Page {
  std::mutex mutex;
  std::condition_variable changed;
  std::string text;
  bool blocked = false;
  bool fails = false;
  int writing = 0;

  void set(bool Page::*what, bool on) {
    const std::lock_guard lock(mutex);
    this->*what = on;
    changed.notify_all();
  }
  void await_writer() {
    std::unique_lock lock(mutex);
    changed.wait(lock, [this] { return writing > 0; });
  }
};

class PageTarget final : public LogTarget {
 public:
  explicit PageTarget(std::shared_ptr<Page> page) : page_(std::move(page)) {}
  bool write(std::string_view lines) override {
    std::unique_lock lock(page_->mutex);
    ++page_->writing;
    page_->changed.notify_all();
    page_->changed.wait(lock, [this] { return !page_->blocked; });
    --page_->writing;
    if (page_->fails) return false;
    page_->text += lines;
    return true;
  }
  void reopen() override {
    const std::lock_guard lock(page_->mutex);
    page_->text += "[reopened]";
  }

 private:
  std::shared_ptr<Page> page_;
};

class LogQueueTest : public testing::Test {
 protected:
  std::unique_ptr<LogQueue> make() {
    return std::make_unique<LogQueue>(std::make_unique<PageTarget>(page), [](std::size_t lines) {
      return "(" + std::to_string(lines) + " lost)\n";
    });
  }
  std::shared_ptr<Page> page = std::make_shared<Page>();
};

TEST_F(LogQueueTest, LinesComeInOrder) {
  const auto queue = make();
  for (int n = 0; n < 3; ++n) queue->add(std::to_string(n) + "\n");
  EXPECT_TRUE(queue->flush());
  EXPECT_EQ(page->text, "0\n1\n2\n");
}

TEST_F(LogQueueTest, ABlockedTargetHoldsUpNobodyAndLostLinesAreTold) {
  page->blocked = true;
  const auto queue = make();
  queue->add("first\n");
  page->await_writer();
  const std::string line(1023, 'x');
  const std::size_t fit = LogQueue::kMostBytes / 1024;
  for (std::size_t n = 0; n < fit + 5; ++n) queue->add(line + "\n");
  page->set(&Page::blocked, false);
  EXPECT_TRUE(queue->flush());
  queue->add("last\n");
  EXPECT_TRUE(queue->flush());
  EXPECT_TRUE(page->text.starts_with("first\n"));
  EXPECT_NE(page->text.find("(5 lost)\n"), std::string::npos);
  EXPECT_TRUE(page->text.ends_with("last\n"));
}

TEST_F(LogQueueTest, WhatATargetRefusesIsToldOnceItTakesLinesAgain) {
  page->fails = true;
  const auto queue = make();
  queue->add("one\ntwo\n");
  EXPECT_TRUE(queue->flush());
  page->set(&Page::fails, false);
  queue->add("three\n");
  EXPECT_TRUE(queue->flush());
  EXPECT_EQ(page->text, "(2 lost)\nthree\n");
}

TEST_F(LogQueueTest, ATargetThatHangsIsLeftToItself) {
  page->blocked = true;
  auto queue = make();
  queue->add("first\n");
  page->await_writer();
  queue.reset();  // comes back
  page->set(&Page::blocked, false);
}

TEST_F(LogQueueTest, ReopensBeforeTheNextLine) {
  const auto queue = make();
  queue->reopen();
  queue->add("new\n");
  EXPECT_TRUE(queue->flush());
  EXPECT_EQ(page->text, "[reopened]new\n");
}

}  // namespace
}  // namespace porttape
