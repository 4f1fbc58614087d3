defmodule BB.Handoff.Outlet.Options do
  @moduledoc "The schema of the options that the docs of `BB.Handoff.Outlet` list."
  @moduledoc no_example: "internal: the docs of BB.Handoff.Outlet list the options"

  @schema BB.Options.new!(
            from: [
              type: {:list, :atom},
              required: true,
              doc: "The pubsub path, with all paths below it."
            ],
            topic: [
              type: {:custom, BB.Topic, :check_declared, []},
              required: true,
              doc: "The ring topic, after the robot's topic prefix (`BB.Topic`)."
            ],
            encoding: [
              type: {:behaviour, BB.Handoff.Encoding},
              required: true,
              doc: "The encoding of the messages."
            ],
            slot_count: [
              type: {:custom, BB.Ring.Publisher, :check_slot_count, []},
              default: 16,
              doc: "As in `BB.Ring.Publisher`."
            ],
            slot_size: [
              type: {:in, 21..0x4000_0000},
              default: 4096,
              doc: "As in `BB.Ring.Publisher`."
            ]
          )

  @doc "Returns the schema of the options."
  @spec schema() :: BB.Options.t()
  def schema, do: @schema
end
