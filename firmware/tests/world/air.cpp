#include "world/air.h"

#include <algorithm>

namespace {
constexpr nanoseconds settling = 130 * us;
constexpr nanoseconds start_up = 1500 * us;
constexpr uint8_t rx_dr = 0x40, tx_ds = 0x20, max_rt = 0x10;
constexpr size_t fifo = 3;
}  // namespace

void air::transmit(packet p, nanoseconds duration) {
  p.begin = world_.now();
  p.end = p.begin + duration;
  while (!flying_.empty() && flying_.front().end < p.begin - 5 * msec) flying_.pop_front();
  for (packet &other : flying_) {
    if (other.channel == p.channel && other.end > p.begin) other.destroyed = p.destroyed = true;
  }
  flying_.push_back(p);
  world_.at(p.end, [this, begin = p.begin, sender = p.sender] {
    const auto it = std::find_if(flying_.begin(), flying_.end(),
                                 [&](const packet &f) { return f.begin == begin && f.sender == sender; });
    if (it == flying_.end() || it->destroyed) return;
    const packet arrived = *it;
    const double p_loss = arrived.ack && ack_loss >= 0 ? ack_loss : loss;
    for (radio_chip *chip : chips_) {
      if (chip != arrived.sender && !world_.happens(p_loss)) chip->hear(arrived);
    }
  });
}

radio_chip::radio_chip(world &w, air &a) : world_(w), air_(a) {
  a.join(this);
  reset();
}

void radio_chip::reset() {
  reg_.fill(0);
  const uint8_t start[] = {0x08, 0x3F, 0x03, 0x03, 0x03, 0x02, 0x0F, 0x0E};
  std::copy(std::begin(start), std::end(start), reg_.begin());
  rx_0_.fill(0xE7);
  rx_1_.fill(0xC2);
  tx_.fill(0xE7);
  status_ = 0;
  out_.clear();
  in_.clear();
  last_identity_ = -1;
  enter(mode::down);
}

nanoseconds radio_chip::duration(size_t bytes, bool enhanced) const {
  const size_t bits =
      8 * (1 + 5 + bytes + 2) + (enhanced ? 9 : 0);  // preamble, address, payload, CRC, control field
  const nanoseconds bit = (reg_[6] & 0x08) ? 500 : 1000;
  return static_cast<nanoseconds>(bits) * bit;
}

uint8_t radio_chip::status() const {
  const uint8_t pipe = in_.empty() ? 7 : 1;
  return static_cast<uint8_t>((status_ & 0x70) | pipe << 1 | (out_.size() == fifo ? 1 : 0));
}

void radio_chip::raise(uint8_t bits) {
  const bool before = irq();
  status_ = static_cast<uint8_t>(status_ | bits);
  if (!before && irq() && on_irq) on_irq();
}

void radio_chip::enter(mode m, nanoseconds span, std::function<void()> then) {
  mode_ = m;
  const uint64_t mine = ++generation_;
  if (span < 0) return;
  world_.at(world_.now() + span, [this, mine, then] {
    if (mine == generation_) then();
  });
}

void radio_chip::enable(bool ce) {
  ce_ = ce;
  think();
}

/// Moves on from what the registers and CE now say.
void radio_chip::think() {
  const bool up = (reg_[0] & 0x02) != 0;
  const bool receiver = (reg_[0] & 0x01) != 0;
  if (!up) {
    if (mode_ != mode::down) enter(mode::down);
    return;
  }
  switch (mode_) {
    case mode::down:
      enter(mode::starting, start_up, [this] {
        enter(mode::standby);
        think();
      });
      return;
    case mode::standby:
      if (ce_ && receiver) {
        enter(mode::rx_settling, settling, [this] {
          enter(mode::rx);
          listening_since_ = world_.now();
        });
      } else if (ce_ && !out_.empty() && (status_ & max_rt) == 0) {
        tries_ = 0;
        enter(mode::tx_settling, settling, [this] { begin_packet(); });
      }
      return;
    case mode::rx:
    case mode::rx_settling:
      if (!ce_ || !receiver) {
        enter(mode::standby);
        think();
      }
      return;
    default: return;  // a transmission takes its course
  }
}

void radio_chip::begin_packet() {
  const bool enhanced = reg_[1] != 0 || (reg_[4] & 0x0F) != 0;
  const nanoseconds span = duration(out_.front().size(), enhanced);
  ++count.sent;
  air_.transmit({this, tx_, out_.front(), identity_, false, enhanced, reg_[5], 0, 0}, span);
  enter(mode::tx, span, [this] { packet_gone(); });
}

void radio_chip::packet_gone() {
  if ((reg_[1] & 0x01) == 0) {  // no ACK wanted
    done_sending();
    return;
  }
  const nanoseconds wait = ((reg_[4] >> 4) + 1) * 250 * us;
  enter(mode::awaiting_ack, wait, [this] { no_ack(); });
}

void radio_chip::no_ack() {
  if (tries_ >= (reg_[4] & 0x0F)) {
    ++count.max_rt;
    enter(mode::standby);
    raise(max_rt);
    return;
  }
  ++tries_;
  begin_packet();
}

void radio_chip::done_sending() {
  out_.pop_front();
  identity_ = static_cast<uint8_t>((identity_ + 1) & 3);
  enter(mode::standby);
  raise(tx_ds);
  think();
}

void radio_chip::hear(const air::packet &p) {
  if (dead || p.channel != reg_[5]) return;
  if (p.ack) {
    const bool mine = mode_ == mode::awaiting_ack && p.address == rx_0_ && (reg_[2] & 1) != 0;
    if (!mine) return;
    ++count.acked;
    done_sending();
    return;
  }
  const bool pipe_0 = (reg_[2] & 1) != 0 && p.address == rx_0_;
  const bool pipe_1 = (reg_[2] & 2) != 0 && p.address == rx_1_;
  const bool enhanced = reg_[1] != 0;
  if (mode_ != mode::rx || listening_since_ > p.begin || !(pipe_0 || pipe_1) || p.enhanced != enhanced)
    return;
  if (p.data.size() != reg_[pipe_1 ? 0x12 : 0x11]) return;
  const bool again = enhanced && last_identity_ == p.identity && last_data_ == p.data;
  if (!again) {
    if (in_.size() == fifo) return;  // full: no ACK either
    in_.push_back(p.data);
    ++count.received;
    raise(rx_dr);
  }
  last_identity_ = p.identity;
  last_data_ = p.data;
  const bool answers = (reg_[1] & (pipe_1 ? 2 : 1)) != 0;
  if (!answers) return;
  enter(mode::acking, settling, [this, address = p.address, identity = p.identity] {
    const nanoseconds span = duration(0, true);
    air_.transmit({this, address, {}, identity, true, true, reg_[5], 0, 0}, span);
    enter(mode::acking, span, [this] {
      enter(mode::rx);
      listening_since_ = world_.now();
      think();
    });
  });
}

uint8_t radio_chip::read_register(uint8_t reg, uint8_t index) const {
  if (reg == 0x0A) return index < 5 ? rx_0_[index] : 0;
  if (reg == 0x0B) return index < 5 ? rx_1_[index] : 0;
  if (reg == 0x10) return index < 5 ? tx_[index] : 0;
  if (reg == 0x07) return status();
  return index == 0 ? reg_[reg] : 0;
}

void radio_chip::write_register(uint8_t reg, const uint8_t *data, uint8_t size) {
  for (uint8_t i = 0; i < size; ++i) {
    if (reg == 0x0A && i < 5) rx_0_[i] = data[i];
    if (reg == 0x0B && i < 5) rx_1_[i] = data[i];
    if (reg == 0x10 && i < 5) tx_[i] = data[i];
  }
  if (reg == 0x07) {
    status_ = static_cast<uint8_t>(status_ & ~(data[0] & 0x70));
  } else if (reg != 0x0A && reg != 0x0B && reg != 0x10 && reg < 0x18) {
    reg_[reg] = data[0];
  }
}

void radio_chip::transfer(uint8_t *bytes, uint8_t size) {
  if (dead) {
    std::fill(bytes, bytes + size, uint8_t{0});
    return;
  }
  const uint8_t command = bytes[0];
  std::vector<uint8_t> sent(bytes + 1, bytes + size);
  const uint8_t before = status();
  for (uint8_t i = 1; i < size; ++i) {
    bytes[i] = 0;
    if (command < 0x20) bytes[i] = read_register(command & 0x1F, static_cast<uint8_t>(i - 1));
    if (command == 0x61 && !in_.empty() && i <= in_.front().size()) bytes[i] = in_.front()[i - 1u];
  }
  bytes[0] = before;
  if (command >= 0x20 && command < 0x40 && !sent.empty()) {
    write_register(command & 0x1F, sent.data(), static_cast<uint8_t>(sent.size()));
  }
  if (command == 0x61 && size > 1 && !in_.empty()) in_.pop_front();
  if (command == 0xA0 && out_.size() < fifo) out_.push_back(sent);
  if (command == 0xE1) out_.clear();
  if (command == 0xE2) in_.clear();
  think();
}
