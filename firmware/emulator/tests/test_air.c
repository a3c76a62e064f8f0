/* Loss and collisions on the air. */
#include <math.h>

#include "radio_rig.h"

void test_air(void)
{
    rig g;
    rig_start(&g, 3, 4);
    rig_link_up(&g);
    rig_put(&g, 0, NRF_SETUP_RETR, 0); /* no repeats: every loss is a failure */
    g.air.loss = 0.2;
    const int count = 1000;
    for (int i = 0; i < count; i++) {
        rig_payload(&g, 0, 0xa0, (uint8_t)i, 32);
        rig_pulse(&g, 0);
        rig_run(&g, 2e-3);
        rig_put(&g, 0, NRF_STATUS, 0x70);
        rig_command(&g, 0, 0xe1, NULL, 0);
        rig_command(&g, 1, 0xe2, NULL, 0);
        rig_put(&g, 1, NRF_STATUS, 0x70);
    }
    /* A packet arrives with 0.8, and is acknowledged with 0.8 squared. */
    CHECK_NEAR(g.radios[1]->total.received + g.radios[1]->total.repeats, 0.8 * count,
               4 * sqrt(0.16 * count));
    CHECK_NEAR(g.radios[0]->total.delivered, 0.64 * count, 4 * sqrt(0.64 * 0.36 * count));

    /* Two packets at once on one channel: neither arrives. */
    g.air.loss = 0.0;
    rig_put(&g, 2, NRF_RF_CH, 76);
    rig_put(&g, 2, NRF_SETUP_RETR, 0);
    rig_put(&g, 2, NRF_CONFIG, 0x0e);
    rig_run(&g, 2e-3);
    unsigned long received = g.radios[1]->total.received;
    rig_payload(&g, 0, 0xa0, 1, 32);
    rig_payload(&g, 2, 0xa0, 1, 32);
    rig_set(&g, 0, RADIO_CE, true);
    rig_set(&g, 2, RADIO_CE, true);
    rig_run(&g, 50e-6);
    rig_set(&g, 0, RADIO_CE, false);
    rig_set(&g, 2, RADIO_CE, false);
    rig_run(&g, 2e-3);
    CHECK(g.air.total.collided == 2);
    CHECK(g.radios[1]->total.received == received);
    rig_finish(&g);
}
