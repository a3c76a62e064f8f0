#include "control/master.h"

#include "boards/hardware.h"
#include "protocol/bytes.h"

namespace {
constexpr uint8_t attempts = 20;  // about 0.1 s; the laptop asks again after that
constexpr uint8_t protocol_version = 1;
}  // namespace

master::master(serial_port &port, nrf24l01 &chip)
    : line_(port, nullptr), chip_(chip), mail_(chip), packit_(&line_, address::master, *this) {}

void master::start(moment now) { chip_.setup(address::master, now); }

void master::poll(moment now) {
  mail_.poll(now);
  frame f;
  if (count_ < queue_length && mail_.receive(f) && f.to == address::laptop) {
    queue_[(first_ + count_++) % queue_length] = f;
  }
  if (line_.poll(now) == serial_line::arrival::a_frame) {
    const frame &in = line_.received();
    if (in.to == address::master) {
      packit_.received(in, &line_);
    } else if (in.to == address::slave_1 && !up_waits_) {
      up_ = in;
      up_waits_ = true;
    }
  }
  if (up_waits_ && mail_.ready()) {
    mail_.send(up_, address::slave_1, attempts);
    up_waits_ = false;
  }
  packit_.poll(now);
  if (count_ > 0 && line_.ready()) {
    line_.send(queue_[first_]);
    first_ = static_cast<uint8_t>((first_ + 1) % queue_length);
    --count_;
  }
}

bool master::obey(const frame &request, frame &reply) {
  byte_writer out(reply.payload);
  if (request.kind == kind::hello) {
    out.u8(protocol_version);
    out.u8(address::master);
    out.u8(0);
    out.u16(hardware::ram_never_used());
    out.u8(0);
    out.u8(0);
  } else {
    out.u8(static_cast<uint8_t>(result::bad_value));
  }
  reply.size = out.size();
  return true;
}
