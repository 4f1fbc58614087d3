defmodule BB.Math.Transform2DTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  import BB.Test.Math, only: [close?: 2, coordinate: 0, transform2d: 0]

  alias BB.Math.Transform2D

  doctest BB.Math.Transform2D

  property "the angle is kept within a turn" do
    forall theta <- coordinate() do
      t = Transform2D.new(0, 0, theta)

      abs(t.theta) <= :math.pi() and close?(:math.cos(t.theta), :math.cos(theta)) and
        close?(:math.sin(t.theta), :math.sin(theta))
    end
  end

  property "composition is associative, with identity as its unit" do
    forall {a, b, c} <- {transform2d(), transform2d(), transform2d()} do
      close?(
        Transform2D.compose(Transform2D.compose(a, b), c),
        Transform2D.compose(a, Transform2D.compose(b, c))
      ) and close?(Transform2D.compose(a, Transform2D.identity()), a)
    end
  end

  property "the inverse undoes the motion" do
    forall t <- transform2d() do
      close?(Transform2D.compose(t, Transform2D.inverse(t)), Transform2D.identity()) and
        close?(Transform2D.compose(Transform2D.inverse(t), t), Transform2D.identity())
    end
  end
end
